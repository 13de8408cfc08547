//! From f64 to integers: centroids become points of the lattice, areas weights. `docs/arithmetic.md` says how, and has
//! all bounds.

use std::ops::{Add, Div, Mul, Range, Sub};

use glam::DVec3;

use super::components::Component;
use crate::mesh::{Frame, MeshView};
use crate::parallel;
use crate::power::factors;
use crate::prefetch::{prefetch, with_lookahead};

/// Lattice coordinates stay below 2 to this power.
pub const COORDINATE_BITS: i32 = 27;
/// A component's areas are scaled to a sum of at most 2 to this power; rounding up to 1 adds less than as much again.
const WEIGHT_SUM_BITS: i32 = 33;
/// No weight exceeds 2 to this power.
const WEIGHT_BITS: i32 = 31;
/// Faces that a thread takes at least. Sums in f64 go by so many, whatever the number of threads.
pub const PIECE: usize = 1 << 12;
/// Exponents of components differ by at most this, or less where there are many.
const MAX_EXPONENT_SPREAD: i32 = 30;

/// A face in lattice units, before rounding.
#[derive(Debug, Clone, Copy, Default)]
pub struct FaceGeometry {
    /// The area-weighted mean of the centroids of the fan's triangles; the mean of the corners when there is no area.
    pub centroid: DVec3,
    /// Sum of the areas of the fan's triangles; on a surface with density, times the relative density.
    pub area: f64,
}

impl FaceGeometry {
    /// A point of this area.
    pub fn new(centroid: DVec3, area: f64) -> Self {
        Self { centroid, area }
    }
}

impl Frame {
    /// Centroid and area of a face, and the second moment inside it: Σ over the fan's triangles of
    /// `area·((|ab|²+|bc|²+|ca|²)/36 + |triangle centroid − face centroid|²)`.
    pub fn face(&self, mesh: MeshView<'_>, face: usize) -> (FaceGeometry, f64) {
        let corners = mesh.faces.corners(face);
        let position = |corner: usize| self.position(mesh.positions.at(corners[corner] as usize));
        let triangle = |corners: [usize; 3]| Triangle { corners: corners.map(|corner| position(corner).to_array()) };
        if let [_, _, _] = corners {
            let triangle = triangle([0, 1, 2]);
            let area = triangle.area();
            return (FaceGeometry { centroid: triangle.centroid().into(), area }, triangle.moment(area));
        }
        let fan = (1..corners.len().saturating_sub(1)).map(|corner| triangle([0, corner, corner + 1]));
        let (mut weighted, mut area) = (DVec3::ZERO, 0.0);
        for triangle in fan.clone() {
            let of_triangle = triangle.area();
            weighted += of_triangle * DVec3::from(triangle.centroid());
            area += of_triangle;
        }
        let centroid = match area > 0.0 {
            true => weighted / area,
            false => (0..corners.len()).map(position).sum::<DVec3>() / corners.len() as f64,
        };
        let inside = fan.map(|triangle| {
            let area = triangle.area();
            triangle.moment(area) + area * DVec3::from(triangle.centroid()).distance_squared(centroid)
        });
        (FaceGeometry { centroid, area }, inside.sum())
    }

    /// Calls `visit` with each index in `faces` and the centroid of the face there.
    pub fn each_centroid(&self, mesh: MeshView<'_>, faces: &[u32], mut visit: impl FnMut(usize, DVec3)) {
        let four = self.fours(mesh, faces, |at, triangles| {
            let [x, y, z] = triangles.centroid();
            (0..4).for_each(|lane| visit(at + lane, DVec3::new(x.0[lane], y.0[lane], z.0[lane])));
        });
        for at in four..faces.len() {
            visit(at, self.face(mesh, faces[at] as usize).0.centroid);
        }
    }

    /// Calls `visit` with each index in `faces` and the result of [`face`](Self::face) for the face there.
    pub fn each_face(&self, mesh: MeshView<'_>, faces: &[u32], mut visit: impl FnMut(usize, FaceGeometry, f64)) {
        let four = self.fours(mesh, faces, |at, triangles| {
            let [x, y, z] = triangles.centroid();
            let area = triangles.area();
            let moment = triangles.moment(area);
            (0..4).for_each(|lane| {
                let centroid = DVec3::new(x.0[lane], y.0[lane], z.0[lane]);
                visit(at + lane, FaceGeometry { centroid, area: area.0[lane] }, moment.0[lane]);
            });
        });
        for at in four..faces.len() {
            let (geometry, moment) = self.face(mesh, faces[at] as usize);
            visit(at, geometry, moment);
        }
    }

    /// Calls `visit` for every four faces of a mesh of triangles; returns how many faces that were.
    #[inline]
    fn fours(&self, mesh: MeshView<'_>, faces: &[u32], mut visit: impl FnMut(usize, Triangle<Four>)) -> usize {
        if !mesh.faces.are_triangles() {
            return 0;
        }
        let corners = mesh.faces.all_corners().as_chunks::<3>().0;
        let (fours, _) = faces.as_chunks::<4>();
        for (at, (faces, ahead)) in with_lookahead(fours).enumerate() {
            if let Some(later) = ahead.stage(2) {
                later.iter().for_each(|&face| prefetch(corners, face as usize));
            }
            if let Some(later) = ahead.stage(1) {
                let vertices = later.iter().flat_map(|&face| corners[face as usize]);
                vertices.for_each(|vertex| mesh.positions.prefetch(vertex as usize));
            }
            let mut of = [[Four([0.0; 4]); 3]; 3];
            let centre = self.centre.to_array();
            for (lane, &face) in faces.iter().enumerate() {
                for (corner, &vertex) in corners[face as usize].iter().enumerate() {
                    let position = mesh.positions.at(vertex as usize);
                    for axis in 0..3 {
                        of[corner][axis].0[lane] = position[axis] - centre[axis];
                    }
                }
            }
            let [first, second] = self.factors.map(|factor| Four([factor; 4]));
            let scaled = of.map(|corner| corner.map(|x| x * first * second));
            visit(4 * at, Triangle { corners: scaled });
        }
        4 * fours.len()
    }

    /// The geometry of all faces, upload order, areas times a density where there is one.
    pub fn faces(&self, mesh: MeshView<'_>, density: impl Fn(usize) -> Option<f64>) -> Vec<FaceGeometry> {
        let geometry = |face: usize| {
            let (mut geometry, _) = self.face(mesh, face);
            geometry.area *= density(face).unwrap_or(1.0);
            geometry
        };
        (0..mesh.faces.len()).map(geometry).collect()
    }

    /// The vector area of a face: of a flat one, its area along its normal.
    pub fn vector_area(&self, mesh: MeshView<'_>, face: usize) -> DVec3 {
        let corners = mesh.faces.corners(face);
        let position = |corner: usize| self.position(mesh.positions.at(corners[corner] as usize));
        let normal = |corner: usize| (position(corner) - position(0)).cross(position(corner + 1) - position(0));
        (1..corners.len().saturating_sub(1)).map(|corner| normal(corner) / 2.0).sum()
    }
}

/// Triangles in lattice units: one, or four at a time, for which the compiler uses vector instructions.
struct Triangle<T> {
    corners: [[T; 3]; 3],
}

impl<T: Real> Triangle<T> {
    #[inline]
    fn centroid(&self) -> [T; 3] {
        let [a, b, c] = self.corners;
        std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / T::from(3.0))
    }

    #[inline]
    fn area(&self) -> T {
        let [a, b, c] = self.corners;
        let (u, v) = (sub(b, a), sub(c, a));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        square(normal).sqrt() / T::from(2.0)
    }

    /// Second moment of area about the centroid, of a triangle of this area.
    #[inline]
    fn moment(&self, area: T) -> T {
        let [a, b, c] = self.corners;
        area * (square(sub(b, a)) + square(sub(c, b)) + square(sub(a, c))) / T::from(36.0)
    }
}

fn sub<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn square<T: Real>(a: [T; 3]) -> T {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
}

/// An f64, or several at a time.
trait Real: Copy + From<f64> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    /// The square root.
    fn sqrt(self) -> Self;
}

impl Real for f64 {
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
}

/// Four f64 at a time, each as it would be alone.
#[derive(Clone, Copy)]
struct Four([f64; 4]);

impl From<f64> for Four {
    fn from(value: f64) -> Self {
        Self([value; 4])
    }
}

impl Real for Four {
    fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }
}

macro_rules! by_lane {
    ($($operation:ident $function:ident),*) => {$(
        impl $operation for Four {
            type Output = Self;

            #[inline]
            fn $function(self, other: Self) -> Self {
                Self(std::array::from_fn(|lane| self.0[lane].$function(other.0[lane])))
            }
        }
    )*};
}
by_lane!(Add add, Sub sub, Mul mul, Div div);

/// The nearest lattice point.
#[inline]
pub fn round_centroid(centroid: DVec3) -> [i32; 3] {
    const MOST: i32 = (1 << COORDINATE_BITS) - 1;
    /// Adding it leaves no fraction, and the integer in the lower bits.
    const MAGIC: f64 = (3u64 << 51) as f64;
    centroid.to_array().map(|coordinate| {
        // the floor, without a call
        let up = coordinate + 0.5;
        let shifted = up + MAGIC;
        let is_above = shifted - MAGIC > up;
        (shifted.to_bits() as i32 - i32::from(is_above)).clamp(-MOST, MOST)
    })
}

/// The weights of faces: the nearest integer to area × 2^exponent, at least 1. The components, given as runs of faces,
/// with what they sum up to. The exponent of the component with the finest unit.
pub fn weigh(area: impl Fn(usize) -> f64 + Sync, runs: &[Range<usize>]) -> (Vec<u32>, Vec<Component>, i32) {
    let (exponents, finest) = exponents(&area, runs);
    let mut weights = Vec::with_capacity(runs.last().map_or(0, |run| run.end));
    let mut components = Vec::with_capacity(runs.len());
    for (run, exponent) in runs.iter().zip(exponents) {
        let [a, b] = factors(exponent);
        weights.extend(run.clone().map(|face| ((area(face) * a * b + 0.5) as u32).max(1)));
        components.push(Component {
            first_face: run.start as u32,
            faces: run.len() as u32,
            weight: weights[run.clone()].iter().map(|&weight| u64::from(weight)).sum(),
            energy_shift: (finest - exponent) as u32,
        });
    }
    (weights, components, finest)
}

/// A warning, if more than half of the given weights are lost beside the largest, and weigh 1 on the lattice.
pub fn lost_weights(given: impl Iterator<Item = f64> + Clone, weights: &[u32], noun: &str) -> Option<String> {
    let unit = libm::ldexp(given.clone().fold(0.0, f64::max), -WEIGHT_BITS);
    let (count, lost) = given.fold((0, 0), |(count, lost), weight| (count + 1, lost + usize::from(weight < unit)));
    let lightest = weights.iter().filter(|&&weight| weight == 1).count();
    (2 * lost > count && 2 * lightest > weights.len()).then(|| {
        format!(
            "weights of {noun} below {unit:e}, which are lost beside the largest and count alike: {lost}; cut off \
             large weights"
        )
    })
}

/// The power of two between areas and weights of each component, and the largest of them. Exponents of C components
/// differ by at most [`MAX_EXPONENT_SPREAD`] and 33 − ⌈log₂ C⌉: then Σ over all of M·2^`energy_shift` is below 2⁶⁷.
fn exponents(area: impl Fn(usize) -> f64 + Sync, runs: &[Range<usize>]) -> (Vec<i32>, i32) {
    let spread = MAX_EXPONENT_SPREAD.min(33 - runs.len().next_power_of_two().trailing_zeros() as i32);
    let wanted: Vec<Option<i32>> = runs
        .iter()
        .map(|run| {
            let add = |a: (f64, f64), b: (f64, f64)| (a.0 + b.0, a.1.max(b.1));
            let of = |faces: Range<usize>| faces.map(&area).map(|area| (area, area)).fold((0.0, 0.0), add);
            let pieces =
                parallel::pieces(run.len(), PIECE, &|piece| of(run.start + piece.start..run.start + piece.end));
            let (sum, largest) = pieces.into_iter().fold((0.0, 0.0), add);
            // x < 2^frexp(x).1
            (sum > 0.0).then(|| (WEIGHT_SUM_BITS - libm::frexp(sum).1).min(WEIGHT_BITS - libm::frexp(largest).1))
        })
        .collect();
    let coarsest = wanted.iter().flatten().copied().min().unwrap_or(0);
    let allowed = coarsest + spread;
    let finest = wanted.iter().flatten().map(|&exponent| exponent.min(allowed)).max().unwrap_or(0);
    // a component without area gets the smallest unit: its faces weigh 1, as little as can be
    let exponents = wanted.into_iter().map(|exponent| exponent.unwrap_or(finest).min(allowed));
    (exponents.collect(), finest)
}
