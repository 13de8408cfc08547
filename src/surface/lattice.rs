//! From f64 to integers. `docs/arithmetic.md` has all bounds.
//!
//! Positions are centred on their bounding box and scaled by a power of two so that the box reaches 2²⁷ at most; a
//! face's centroid is rounded to the nearest lattice point, its area × 2^exponent to the nearest integer, at least 1.
//! The exponent is a component's own, so that a small part beside a large one keeps its resolution; exponents differ by
//! 30 at most, so that energies of all components add up exactly in 128 bits.

use std::ops::Range;

use glam::DVec3;

use crate::mesh::{Frame, PolygonMesh, factors};
use crate::prefetch::{Ahead, prefetch};

/// Lattice coordinates stay below 2 to this power.
pub const COORDINATE_BITS: i32 = 27;
/// A component's areas are scaled to a sum of at most 2 to this power; rounding up to 1 adds less than as much again.
const WEIGHT_SUM_BITS: i32 = 33;
/// No weight exceeds 2 to this power.
const WEIGHT_BITS: i32 = 31;
/// Exponents of components differ by at most this.
const MAX_EXPONENT_SPREAD: i32 = 30;

/// A face in lattice units, before rounding.
#[derive(Debug, Clone, Copy, Default)]
pub struct FaceGeometry {
    /// The area-weighted mean of the centroids of the fan's triangles; the mean of the corners when there is no area.
    pub centroid: DVec3,
    /// Sum of the areas of the fan's triangles; on a surface with density, times the relative density.
    pub area: f64,
}

impl Frame {
    /// The triangles of the fan that a face is cut into.
    #[inline]
    fn fan<'a>(&'a self, mesh: &'a PolygonMesh, face: usize) -> impl Iterator<Item = [DVec3; 3]> + Clone + 'a {
        let corners = mesh.faces.corners(face);
        let position = |corner: usize| self.position(mesh.positions[corners[corner] as usize]);
        (1..corners.len().saturating_sub(1)).map(move |corner| [0, corner, corner + 1].map(position))
    }

    /// Centroid and area of a face.
    pub fn face(&self, mesh: &PolygonMesh, face: usize) -> FaceGeometry {
        let corners = mesh.faces.corners(face);
        let fan = self.fan(mesh, face);
        if let ([_, _, _], Some(triangle)) = (corners, fan.clone().next()) {
            return FaceGeometry { centroid: centroid(triangle), area: area(triangle) };
        }
        let (mut weighted, mut sum) = (DVec3::ZERO, 0.0);
        for triangle in fan {
            weighted += area(triangle) * centroid(triangle);
            sum += area(triangle);
        }
        if sum > 0.0 {
            return FaceGeometry { centroid: weighted / sum, area: sum };
        }
        let sum: DVec3 = corners.iter().map(|&corner| self.position(mesh.positions[corner as usize])).sum();
        FaceGeometry { centroid: sum / corners.len() as f64, area: 0.0 }
    }

    /// The second moment inside a face: Σ over the fan's triangles of
    /// `area·((|ab|²+|bc|²+|ca|²)/36 + |triangle centroid − face centroid|²)`.
    pub fn moment_inside(&self, mesh: &PolygonMesh, face: usize, geometry: &FaceGeometry) -> f64 {
        let of_triangle = |triangle: [DVec3; 3]| {
            let [a, b, c] = triangle;
            let sides = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
            area(triangle) * (sides / 36.0 + centroid(triangle).distance_squared(geometry.centroid))
        };
        self.fan(mesh, face).map(of_triangle).sum()
    }

    /// The geometry of all faces, upload order, areas times a density where there is one.
    pub fn faces(&self, mesh: &PolygonMesh, density: impl Fn(usize) -> Option<f64>) -> Vec<FaceGeometry> {
        let geometry = |face: usize| {
            let mut geometry = self.face(mesh, face);
            geometry.area *= density(face).unwrap_or(1.0);
            geometry
        };
        (0..mesh.faces.len()).map(geometry).collect()
    }

    /// The vector area of a face: of a flat one, its area along its normal.
    pub fn vector_area(&self, mesh: &PolygonMesh, face: usize) -> DVec3 {
        self.fan(mesh, face).map(|triangle| doubled_normal(triangle) / 2.0).sum()
    }
}

/// Requests the positions of the corners of faces to come.
#[inline]
pub fn prefetch_corners(mesh: &PolygonMesh, ahead: &Ahead<'_, u32>) {
    if let Some(&later) = ahead.stage(2) {
        prefetch(mesh.faces.all_corners(), mesh.faces.corner_range(later as usize).start);
    }
    if let Some(&later) = ahead.stage(1) {
        mesh.faces.corners(later as usize).iter().for_each(|&corner| prefetch(&mesh.positions, corner as usize));
    }
}

#[inline]
fn centroid([a, b, c]: [DVec3; 3]) -> DVec3 {
    (a + b + c) / 3.0
}

#[inline]
fn area(triangle: [DVec3; 3]) -> f64 {
    doubled_normal(triangle).length() / 2.0
}

/// The normal of a triangle, twice as long as its area.
#[inline]
fn doubled_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// The nearest lattice point.
#[inline]
pub fn round_centroid(centroid: DVec3) -> [i32; 3] {
    const MOST: i32 = (1 << COORDINATE_BITS) - 1;
    centroid.to_array().map(|coordinate| {
        let up = coordinate + 0.5;
        // the floor; `f64::floor` is a call on x86-64
        let truncated = up as i32;
        (truncated - i32::from(f64::from(truncated) > up)).clamp(-MOST, MOST)
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
                largest = face.area.max(largest);
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

/// The weights of areas in a component: the nearest integer to area × 2^exponent, at least 1.
pub fn weight(exponent: i32) -> impl Fn(f64) -> u32 {
    let [a, b] = factors(exponent);
    move |area| ((area * a * b + 0.5) as u32).max(1)
}
