//! From f64 to integers (DESIGN §3).
//!
//! Positions are centred on their bounding box and scaled by a power of two so that the box reaches 2²⁷ at most; a
//! face's centroid is rounded to the nearest lattice point, its area × 2^exponent to the nearest integer, at least 1.
//! The exponent is a component's own, so that a small part beside a large one keeps its resolution; exponents differ by
//! 30 at most, so that energies of all components add up exactly in 128 bits.

use std::ops::Range;

use crate::mesh::PolygonMesh;

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
    /// 2^exponent in two factors, because one may not be a finite f64.
    factors: [f64; 2],
}

/// A face in lattice units, before rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceGeometry {
    /// Area-weighted mean of the centroids of the fan's triangles; mean of the corners when there is no area.
    pub centroid: [f64; 3],
    /// Sum of the areas of the fan's triangles; on a surface with density, times the relative density.
    pub area: f64,
}

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
        Self { centre, exponent, factors: [libm::ldexp(1.0, half), libm::ldexp(1.0, exponent - half)] }
    }

    /// A position in lattice units.
    pub fn position(&self, source: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| (source[axis] - self.centre[axis]) * self.factors[0] * self.factors[1])
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
            let triangle = Triangle::new(position(0), position(1), position(2));
            let geometry = FaceGeometry { centroid: triangle.centroid(), area: triangle.area };
            return (geometry, triangle.moment());
        }
        let fan = |corner: usize| Triangle::new(position(0), position(corner), position(corner + 1));
        let mut area = 0.0;
        let mut weighted = [0.0; 3];
        for corner in 1..corners.len().saturating_sub(1) {
            let triangle = fan(corner);
            let centroid = triangle.centroid();
            area += triangle.area;
            for axis in 0..3 {
                weighted[axis] += triangle.area * centroid[axis];
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
                triangle.moment() + triangle.area * square(sub(triangle.centroid(), centroid))
            })
            .sum();
        (FaceGeometry { centroid, area }, inside)
    }
}

impl Frame {
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

/// A triangle in lattice units.
struct Triangle {
    corners: [[f64; 3]; 3],
    area: f64,
}

impl Triangle {
    fn new(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Self {
        Self { corners: [a, b, c], area: square(doubled_normal(a, b, c)).sqrt() / 2.0 }
    }

    fn centroid(&self) -> [f64; 3] {
        let [a, b, c] = self.corners;
        std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0)
    }

    /// Second moment of area about the centroid.
    fn moment(&self) -> f64 {
        let [a, b, c] = self.corners;
        self.area * (square(sub(b, a)) + square(sub(c, b)) + square(sub(a, c))) / 36.0
    }
}

/// The normal of a triangle, twice as long as its area.
fn doubled_normal(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> [f64; 3] {
    let (u, v) = (sub(b, a), sub(c, a));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn square(a: [f64; 3]) -> f64 {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
}

/// The nearest lattice point.
#[inline]
pub fn round_centroid(centroid: [f64; 3]) -> [i32; 3] {
    const MOST: i32 = (1 << COORDINATE_BITS) - 1;
    centroid.map(|coordinate| {
        // the floor, without a call; what is beyond an i32 stays there
        let up = coordinate + 0.5;
        let towards_zero = up as i32;
        towards_zero.saturating_sub(i32::from(up < f64::from(towards_zero))).clamp(-MOST, MOST)
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
                sum += face.area;
                largest = if face.area > largest { face.area } else { largest };
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
        let is_normal = (f64::MIN_EXP - 1..f64::MAX_EXP).contains(&exponent);
        Self { exponent, factor: is_normal.then(|| libm::ldexp(1.0, exponent)) }
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
