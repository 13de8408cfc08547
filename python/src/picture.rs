//! A picture of a mesh for notebooks: seen along a diagonal, a hue a cluster, dark lines between clusters.
//!
//! Clusters that touch in the picture have different hues where eight suffice. The picture has at most [`WIDTH`] ×
//! [`HEIGHT`] pixels, and the work is bounded by [`MOST_SAMPLES`], whatever the mesh.

use std::ops::Range;

use tesserae_mesh::export::colour::HUES;
use tesserae_mesh::export::fan;
use tesserae_mesh::mesh::PolygonMesh;
use tesserae_mesh::{Error, Kind, Result};

/// Largest width in pixels.
const WIDTH: usize = 720;

/// Largest height in pixels.
const HEIGHT: usize = 540;

/// Pixels around the mesh.
const MARGIN: usize = 4;

/// Samples a pixel in each direction.
const FINER: usize = 3;

/// Most samples that all faces together cover: 120 layers of faces over the whole picture.
const MOST_SAMPLES: usize = 120 * FINER * FINER * WIDTH * HEIGHT;

/// Fewest visible samples a cluster for which lines are drawn between clusters.
const LEAST_SAMPLES: usize = 24 * FINER * FINER;

/// To the right, up, and towards the eye: y is up, and the eye is in front, to the right and above.
const VIEW: [[f64; 3]; 3] = [[0.8660, 0.0, -0.5], [-0.2113, 0.9063, -0.3660], [0.4532, 0.4226, 0.7849]];

/// Direction of the light in the axes of the view.
const LIGHT: [f64; 3] = [-0.42, 0.58, 0.70];

/// The colour of a mesh without clusters.
const PLAIN: [u8; 3] = [236, 222, 194];

/// The part of its light that a sample on a line keeps.
const ON_LINE: f32 = 0.3;

/// No face.
const NONE: u32 = u32::MAX;

/// A picture: rows of pixels, each red, green, blue and opacity.
pub struct Picture {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Four bytes a pixel.
    pub bytes: Vec<u8>,
}

/// Draws a mesh with a colour a cluster; without labels in one colour, with the edges of its faces.
///
/// # Errors
/// Faces cover one another so often that the work would exceed [`MOST_SAMPLES`] ([`Kind::TooLarge`]).
pub fn draw(mesh: &PolygonMesh, labels: Option<&[u32]>) -> Result<Picture> {
    let view = View::of(mesh);
    let corners: Vec<[f64; 3]> = mesh.positions.iter().map(|&point| view.place(point)).collect();
    let mut samples = Samples::new(&view);
    for face in 0..mesh.faces.len() {
        for triangle in fan(mesh.faces.corners(face)) {
            samples.add(face as u32, triangle.map(|corner| corners[corner as usize]))?;
        }
    }
    let shades: Vec<f32> = (0..mesh.faces.len()).map(|face| shade(&corners, mesh.faces.corners(face))).collect();
    let label = |face: u32| labels.map_or(face, |labels| labels[face as usize]);
    let seen = samples.seen(label);
    let has_lines = samples.covered() >= seen.len() * LEAST_SAMPLES;
    let hues = if has_lines && labels.is_some() { samples.hues(label, &seen) } else { Vec::new() };
    let colour = |face: u32| match labels {
        None => PLAIN,
        Some(_) => HUES[hues.get(label(face) as usize).map_or(label(face) as usize % HUES.len(), |&hue| hue)],
    };
    let lit = |face: u32| colour(face).map(|channel| (f32::from(channel) * shades[face as usize]).min(255.0));
    Ok(samples.picture(label, lit, has_lines))
}

/// Where points are in the picture.
struct View {
    /// What coordinates are divided by first, so that no sum overflows.
    unit: f64,
    low: [f64; 3],
    scale: f64,
    width: usize,
    height: usize,
}

impl View {
    /// The view in which the points of all faces fill the picture.
    fn of(mesh: &PolygonMesh) -> Self {
        let points = || mesh.faces.all_corners().iter().map(|&corner| mesh.positions[corner as usize]);
        let largest = points().flatten().fold(0.0, |largest: f64, x| largest.max(x.abs()));
        let unit = if largest > 0.0 { largest } else { 1.0 };
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in points() {
            let turned = turned(point, unit);
            for axis in 0..3 {
                low[axis] = low[axis].min(turned[axis]);
                high[axis] = high[axis].max(turned[axis]);
            }
        }
        let room = [WIDTH, HEIGHT].map(|pixels| (pixels - 2 * MARGIN) as f64);
        let size = [0, 1].map(|axis| (high[axis] - low[axis]).max(0.0));
        let scale = (room[0] / size[0]).min(room[1] / size[1]);
        let scale = if scale.is_finite() { scale } else { 1.0 };
        let [width, height] = size.map(|size| (size * scale).ceil() as usize + 2 * MARGIN);
        Self { unit, low, scale, width: width.min(WIDTH), height: height.min(HEIGHT) }
    }

    /// A point in samples: to the right, down, and towards the eye.
    fn place(&self, point: [f64; 3]) -> [f64; 3] {
        let turned = turned(point, self.unit);
        let [x, y, z] = [0, 1, 2].map(|axis| (turned[axis] - self.low[axis]) * self.scale);
        let (margin, finer) = (MARGIN as f64, FINER as f64);
        [(x + margin) * finer, (self.height as f64 - margin - y) * finer, z * finer]
    }
}

fn turned(point: [f64; 3], unit: f64) -> [f64; 3] {
    VIEW.map(|axis| (0..3).map(|at| axis[at] * (point[at] / unit)).sum())
}

/// The light that a face reflects, the same from both sides.
fn shade(points: &[[f64; 3]], corners: &[u32]) -> f32 {
    let products = fan(corners).map(|triangle| {
        let [a, b, c] = triangle.map(|corner| points[corner as usize]);
        let (u, v) = (difference(b, a), difference(c, a));
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    });
    let [x, y, z] = products.fold([0.0; 3], |sum, product| [0, 1, 2].map(|axis| sum[axis] + product[axis]));
    // y of samples is downwards, which turns normals over
    let length = (x * x + y * y + z * z).sqrt();
    let facing = if z < 0.0 { -1.0 } else { 1.0 };
    let along = (x * LIGHT[0] - y * LIGHT[1] + z * LIGHT[2]) * facing;
    let lit = if length > 0.0 { (along / length).max(0.0) } else { 1.0 };
    (0.5 + 0.55 * lit) as f32
}

fn difference(of: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| of[axis] - from[axis])
}

/// The nearest face at every sample.
struct Samples {
    width: usize,
    height: usize,
    faces: Vec<u32>,
    depths: Vec<f32>,
    spent: usize,
}

impl Samples {
    fn new(view: &View) -> Self {
        let (width, height) = (view.width * FINER, view.height * FINER);
        let count = width * height;
        Self { width, height, faces: vec![NONE; count], depths: vec![f32::NEG_INFINITY; count], spent: 0 }
    }

    /// Adds a triangle, row by row.
    fn add(&mut self, face: u32, corners: [[f64; 3]; 3]) -> Result<()> {
        let [a, b, c] = corners;
        let (u, v) = (difference(b, a), difference(c, a));
        // not a number for a triangle seen from the side, which hides nothing
        let twice = u[0] * v[1] - u[1] * v[0];
        let (along_x, along_y) = ((u[2] * v[1] - v[2] * u[1]) / twice, (u[0] * v[2] - v[0] * u[2]) / twice);
        let rows = between(corners.map(|corner| corner[1]), self.height);
        self.spent += rows.len();
        for row in rows {
            let y = row as f64 + 0.5;
            // where sides cross the row: two of them, or three at a corner
            let sides = [(a, b), (b, c), (c, a)];
            let crossings = sides.map(|(from, to)| match (from[1] <= y) != (to[1] <= y) {
                true => Some(from[0] + (y - from[1]) / (to[1] - from[1]) * (to[0] - from[0])),
                false => None,
            });
            let columns = between(crossings.into_iter().flatten(), self.width);
            self.spent += columns.len();
            for column in columns {
                let depth = (a[2] + along_x * (column as f64 + 0.5 - a[0]) + along_y * (y - a[1])) as f32;
                let at = row * self.width + column;
                if depth > self.depths[at] {
                    (self.depths[at], self.faces[at]) = (depth, face);
                }
            }
        }
        match self.spent <= MOST_SAMPLES {
            true => Ok(()),
            false => Err(Error::new(Kind::TooLarge, "faces cover one another too often for a picture")),
        }
    }

    /// Number of samples that show a face.
    fn covered(&self) -> usize {
        self.faces.iter().filter(|&&face| face != NONE).count()
    }

    /// The labels that are seen, in ascending order.
    fn seen(&self, label: impl Fn(u32) -> u32) -> Vec<u32> {
        let mut seen: Vec<u32> = self.faces.iter().filter(|&&face| face != NONE).map(|&face| label(face)).collect();
        seen.sort_unstable();
        seen.dedup();
        seen
    }

    /// The hue of each label up to the largest that is seen: the one that fewest of its neighbours in the picture have.
    fn hues(&self, label: impl Fn(u32) -> u32, seen: &[u32]) -> Vec<usize> {
        let of = |at: usize| self.faces.get(at).filter(|&&face| face != NONE).map(|&face| label(face));
        let mut pairs: Vec<(u32, u32)> = (0..self.faces.len())
            .flat_map(|at| [at + 1, at + self.width].map(|beside| (of(at), of(beside))))
            .filter_map(|(one, other)| one.zip(other).filter(|(one, other)| one != other))
            .flat_map(|(one, other)| [(one, other), (other, one)])
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let largest = seen.last().copied().unwrap_or_default() as usize;
        let mut hues: Vec<usize> = (0..=largest).map(|label| label % HUES.len()).collect();
        let mut total = [0; HUES.len()];
        for neighbours in pairs.chunk_by(|a, b| a.0 == b.0) {
            let own = neighbours[0].0;
            let mut used = [0; HUES.len()];
            // those after it have no hue yet
            let before = neighbours.iter().map_while(|&(_, other)| (other < own).then(|| hues[other as usize]));
            before.for_each(|hue| used[hue] += 1);
            let best = (0..HUES.len()).min_by_key(|&hue| (used[hue], total[hue])).unwrap_or_default();
            hues[own as usize] = best;
            total[best] += 1;
        }
        hues
    }

    /// The picture, a mean of samples a pixel.
    fn picture(&self, label: impl Fn(u32) -> u32, colour: impl Fn(u32) -> [f32; 3], has_lines: bool) -> Picture {
        let (width, height) = (self.width / FINER, self.height / FINER);
        let mut bytes = Vec::with_capacity(4 * width * height);
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let (mut sum, mut covered) = ([0.0; 3], 0.0);
            for at in 0..FINER * FINER {
                let (y, x) = (row * FINER + at / FINER, column * FINER + at % FINER);
                let face = self.faces[y * self.width + x];
                if face == NONE {
                    continue;
                }
                let light = if has_lines && self.is_on_line(x, y, &label) { ON_LINE } else { 1.0 };
                covered += 1.0;
                sum.iter_mut().zip(colour(face)).for_each(|(sum, channel)| *sum += channel * light);
            }
            let mean = |sum: f32| if covered > 0.0 { (sum / covered + 0.5) as u8 } else { 0 };
            bytes.extend(sum.map(mean));
            bytes.push((255.0 * covered / (FINER * FINER) as f32 + 0.5) as u8);
        }
        Picture { width, height, bytes }
    }

    /// Whether a neighbouring sample shows another cluster, or none.
    fn is_on_line(&self, x: usize, y: usize, label: &impl Fn(u32) -> u32) -> bool {
        let of = |x: usize, y: usize| match self.faces[y * self.width + x] {
            NONE => None,
            face => Some(label(face)),
        };
        let own = of(x, y);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.height);
        columns.into_iter().any(|x| of(x, y) != own) || rows.into_iter().any(|y| of(x, y) != own)
    }
}

/// The samples whose middles lie between the smallest and the largest of some numbers.
fn between(numbers: impl IntoIterator<Item = f64>, limit: usize) -> Range<usize> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for number in numbers {
        (low, high) = (low.min(number), high.max(number));
    }
    let [first, end] = [low, high].map(|number| ((number - 0.5).ceil().max(0.0) as usize).min(limit));
    first..end.max(first)
}
