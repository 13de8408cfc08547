//! From f64 to integers. `docs/arithmetic.md` has all bounds.
//!
//! Positions are centred on their bounding box and scaled by a power of two so that the box reaches 2²⁷ at most; a
//! face's centroid is rounded to the nearest lattice point, its area × 2^exponent to the nearest integer, at least 1.
//! The exponent is a component's own, so that a small part beside a large one keeps its resolution; exponents differ by
//! 30 at most, so that energies of all components add up exactly in 128 bits.

use std::ops::{Add, Div, Mul, Range, Sub};

use crate::mesh::PolygonMesh;
use crate::prefetch::{prefetch, with_lookahead};

/// Lattice coordinates stay below 2 to this power.
const COORDINATE_BITS: i32 = 27;
/// A component's areas are scaled to a sum of at most 2 to this power; rounding up to 1 adds less than as much again.
const WEIGHT_SUM_BITS: i32 = 33;
/// No weight exceeds 2 to this power.
const WEIGHT_BITS: i32 = 31;
/// Exponents of components differ by at most this.
const MAX_EXPONENT_SPREAD: i32 = 30;

/// Where the lattice lies: lattice coordinate = (source coordinate − centre) × 2^exponent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    centre: [f64; 3],
    /// Power of two between source and lattice lengths.
    pub exponent: i32,
    /// 2^exponent, where that is a normal f64,
    factor: Option<f64>,
    /// and in two factors.
    factors: [f64; 2],
}

/// A face in lattice units, before rounding: its centroid and its [`AREA`].
///
/// The centroid is the area-weighted mean of the centroids of the fan's triangles; the mean of the corners when there
/// is no area. The area is the sum of the areas of the fan's triangles; on a surface with density, times the relative
/// density.
pub type FaceGeometry = [f64; 4];

/// Where a face's geometry has its area.
pub const AREA: usize = 3;

impl Frame {
    /// The frame of some positions.
    pub fn of<'a>(positions: impl Iterator<Item = &'a [f64; 3]>) -> Self {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for position in positions {
            for axis in 0..3 {
                low[axis] = if position[axis] < low[axis] { position[axis] } else { low[axis] };
                high[axis] = if position[axis] > high[axis] { position[axis] } else { high[axis] };
            }
        }
        // halves first: the sum and the difference of two finite numbers may not be finite
        let centre = std::array::from_fn(|axis| low[axis] / 2.0 + high[axis] / 2.0);
        let reach = (0..3).map(|axis| high[axis] / 2.0 - low[axis] / 2.0).fold(0.0, f64::max);
        let exponent = if reach > 0.0 { COORDINATE_BITS - libm::frexp(reach).1 } else { 0 };
        let half = exponent / 2;
        let factor = is_normal(exponent).then(|| libm::ldexp(1.0, exponent));
        Self { centre, exponent, factor, factors: [libm::ldexp(1.0, half), libm::ldexp(1.0, exponent - half)] }
    }

    /// Log₂ of the longest side in source units, rounded up.
    pub fn longest_side_exponent(&self) -> i32 {
        COORDINATE_BITS + 1 - self.exponent
    }

    /// A position in lattice units.
    #[inline]
    pub fn position(&self, source: [f64; 3]) -> [f64; 3] {
        let offset: [f64; 3] = std::array::from_fn(|axis| source[axis] - self.centre[axis]);
        match self.factor {
            Some(factor) => offset.map(|x| x * factor),
            None => offset.map(|x| x * self.factors[0] * self.factors[1]),
        }
    }

    /// A position in source units.
    pub fn source_position(&self, lattice: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| libm::ldexp(lattice[axis], -self.exponent) + self.centre[axis])
    }

    /// Centroid and area of a face, and the second moment inside it: Σ over the fan's triangles of
    /// `area·((|ab|²+|bc|²+|ca|²)/36 + |triangle centroid − face centroid|²)`.
    pub fn face(&self, mesh: &PolygonMesh, face: usize) -> (FaceGeometry, f64) {
        let corners = mesh.faces.corners(face);
        let position = |corner: usize| self.position(mesh.positions[corners[corner] as usize]);
        if let [_, _, _] = corners {
            let triangle = Triangle { corners: [position(0), position(1), position(2)] };
            let [x, y, z] = triangle.centroid();
            let area = triangle.area();
            return ([x, y, z, area], triangle.moment(area));
        }
        let fan = |corner: usize| Triangle { corners: [position(0), position(corner), position(corner + 1)] };
        let mut area = 0.0;
        let mut weighted = [0.0; 3];
        for corner in 1..corners.len().saturating_sub(1) {
            let triangle = fan(corner);
            let centroid = triangle.centroid();
            let of_triangle = triangle.area();
            area += of_triangle;
            for axis in 0..3 {
                weighted[axis] += of_triangle * centroid[axis];
            }
        }
        let centroid = if area > 0.0 {
            weighted.map(|sum| sum / area)
        } else {
            let mut sum = [0.0; 3];
            for corner in 0..corners.len() {
                let position = position(corner);
                for axis in 0..3 {
                    sum[axis] += position[axis];
                }
            }
            sum.map(|sum| sum / corners.len() as f64)
        };
        let inside = (1..corners.len().saturating_sub(1))
            .map(|corner| {
                let triangle = fan(corner);
                let area = triangle.area();
                triangle.moment(area) + area * square(sub(triangle.centroid(), centroid))
            })
            .sum();
        let [x, y, z] = centroid;
        ([x, y, z, area], inside)
    }
}

impl Frame {
    /// Calls `visit` with each index in `faces` and the centroid of the face there.
    pub fn each_centroid(&self, mesh: &PolygonMesh, faces: &[u32], mut visit: impl FnMut(usize, [f64; 3])) {
        let four = self.fours(mesh, faces, |at, triangles| {
            let [x, y, z] = triangles.centroid();
            (0..4).for_each(|lane| visit(at + lane, [x.0[lane], y.0[lane], z.0[lane]]));
        });
        for at in four..faces.len() {
            let ([x, y, z, _], _) = self.face(mesh, faces[at] as usize);
            visit(at, [x, y, z]);
        }
    }

    /// Calls `visit` with each index in `faces` and the result of [`face`](Self::face) for the face there.
    pub fn each_face(&self, mesh: &PolygonMesh, faces: &[u32], mut visit: impl FnMut(usize, FaceGeometry, f64)) {
        let four = self.fours(mesh, faces, |at, triangles| {
            let [x, y, z] = triangles.centroid();
            let area = triangles.area();
            let moment = triangles.moment(area);
            (0..4).for_each(|lane| {
                visit(at + lane, [x.0[lane], y.0[lane], z.0[lane], area.0[lane]], moment.0[lane]);
            });
        });
        for at in four..faces.len() {
            let (geometry, moment) = self.face(mesh, faces[at] as usize);
            visit(at, geometry, moment);
        }
    }

    /// Calls `visit` for every four faces of a mesh of triangles; returns how many faces that were.
    #[inline]
    fn fours(&self, mesh: &PolygonMesh, faces: &[u32], mut visit: impl FnMut(usize, Triangle<Four>)) -> usize {
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
                vertices.for_each(|vertex| prefetch(&mesh.positions, vertex as usize));
            }
            let mut of = [[Four([0.0; 4]); 3]; 3];
            for (lane, &face) in faces.iter().enumerate() {
                for (corner, &vertex) in corners[face as usize].iter().enumerate() {
                    let position = mesh.positions[vertex as usize];
                    for axis in 0..3 {
                        of[corner][axis].0[lane] = position[axis] - self.centre[axis];
                    }
                }
            }
            let factors = match self.factor {
                Some(factor) => [factor, 1.0],
                None => self.factors,
            };
            let scaled = of.map(|corner| corner.map(|x| x * Four([factors[0]; 4]) * Four([factors[1]; 4])));
            visit(4 * at, Triangle { corners: scaled });
        }
        4 * fours.len()
    }

    /// The geometry of all faces, upload order, areas times a density where there is one.
    pub fn faces(&self, mesh: &PolygonMesh, density: impl Fn(usize) -> Option<f64>) -> Vec<FaceGeometry> {
        let geometry = |face: usize| {
            let (mut geometry, _) = self.face(mesh, face);
            if let Some(density) = density(face) {
                geometry[AREA] *= density;
            }
            geometry
        };
        (0..mesh.faces.len()).map(geometry).collect()
    }

    /// The vector area of a face: of a flat one, its area along its normal.
    pub fn vector_area(&self, mesh: &PolygonMesh, face: usize) -> [f64; 3] {
        let corners = mesh.faces.corners(face);
        let position = |corner: usize| self.position(mesh.positions[corners[corner] as usize]);
        let mut sum = [0.0; 3];
        for corner in 1..corners.len().saturating_sub(1) {
            let normal = doubled_normal(position(0), position(corner), position(corner + 1));
            for axis in 0..3 {
                sum[axis] += normal[axis] / 2.0;
            }
        }
        sum
    }
}

/// Whether 2^exponent is a normal f64.
fn is_normal(exponent: i32) -> bool {
    (f64::MIN_EXP - 1..f64::MAX_EXP).contains(&exponent)
}

/// Triangles in lattice units: one, or four at a time, which the compiler makes two or four operations of one.
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
        square(doubled_normal(a, b, c)).sqrt() / T::from(2.0)
    }

    /// Second moment of area about the centroid, of a triangle of this area.
    #[inline]
    fn moment(&self, area: T) -> T {
        let [a, b, c] = self.corners;
        area * (square(sub(b, a)) + square(sub(c, b)) + square(sub(a, c))) / T::from(36.0)
    }
}

/// The normal of a triangle, twice as long as its area.
fn doubled_normal<T: Real>(a: [T; 3], b: [T; 3], c: [T; 3]) -> [T; 3] {
    let (u, v) = (sub(b, a), sub(c, a));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
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
pub fn round_centroid(centroid: [f64; 3]) -> [i32; 3] {
    const MOST: i32 = (1 << COORDINATE_BITS) - 1;
    /// Adding it leaves no fraction, and the integer in the lower bits.
    const MAGIC: f64 = (3u64 << 51) as f64;
    centroid.map(|coordinate| {
        // the floor, without a call
        let up = coordinate + 0.5;
        let shifted = up + MAGIC;
        let is_above = shifted - MAGIC > up;
        (shifted.to_bits() as i32 - i32::from(is_above)).clamp(-MOST, MOST)
    })
}

/// How areas become weights.
#[derive(Debug, PartialEq, Eq)]
pub struct Scales {
    /// Power of two between areas in lattice units and weights, one a component.
    pub exponents: Vec<i32>,
    /// The largest of them.
    pub finest: i32,
}

/// Chooses the exponent of each component, given as a run of faces.
pub fn scales(geometry: &[FaceGeometry], runs: &[Range<usize>]) -> Scales {
    let wanted: Vec<Option<i32>> = runs
        .iter()
        .map(|run| {
            let faces = &geometry[run.clone()];
            let (mut sum, mut largest) = (0.0, 0.0);
            for face in faces {
                sum += face[AREA];
                largest = if face[AREA] > largest { face[AREA] } else { largest };
            }
            // x < 2^frexp(x).1
            (sum > 0.0).then(|| (WEIGHT_SUM_BITS - libm::frexp(sum).1).min(WEIGHT_BITS - libm::frexp(largest).1))
        })
        .collect();
    let coarsest = wanted.iter().flatten().copied().min().unwrap_or(0);
    let allowed = coarsest + MAX_EXPONENT_SPREAD;
    let finest = wanted.iter().flatten().map(|&exponent| exponent.min(allowed)).max().unwrap_or(0);
    // a component without area gets the smallest unit: its faces weigh 1, as little as can be
    let exponents = wanted.into_iter().map(|exponent| exponent.unwrap_or(finest).min(allowed)).collect();
    Scales { exponents, finest }
}

/// What areas are multiplied by to become weights: a power of two.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    exponent: i32,
    /// 2^exponent, where that is a normal f64.
    factor: Option<f64>,
}

impl Scale {
    /// 2^exponent.
    pub fn new(exponent: i32) -> Self {
        Self { exponent, factor: is_normal(exponent).then(|| libm::ldexp(1.0, exponent)) }
    }

    /// The weight of an area: nearest integer, at least 1.
    #[inline]
    pub fn weight(self, area: f64) -> u32 {
        let scaled = match self.factor {
            Some(factor) => area * factor,
            None => libm::ldexp(area, self.exponent),
        };
        ((scaled + 0.5) as u32).max(1)
    }
}
