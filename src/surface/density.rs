//! Density: what a unit of area counts, from weights that the caller gives and from the curvature (Valette, Chassery &
//! Prost 2008). Where it is higher, clusters are smaller: in the limit of many, a cluster's width goes as
//! density^(−1/4).
//!
//! Densities only matter relative to each other. They are divided by the largest before they meet the lattice, so that
//! equal ones give exactly the labels that none give; energies in source units are multiplied by the largest
//! again. A face that counts less than a unit of the lattice counts one unit (the faces of a component share some 2³³).

use super::curvature;
use super::lattice::FaceGeometry;
use super::weld::Weld;
use crate::error::{Error, Result};
use crate::mesh::{Frame, MeshView};

/// Curvatures are kept within this factor of their root mean square, up and down: so flat parts count too, and a crease
/// does not take all clusters.
const CURVATURE_RANGE: f64 = 100.0;

/// What decides the sizes of clusters besides area.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wanted<'a> {
    /// One weight a face or one a vertex of the upload; of a vertex, its faces take the mean of their corners.
    pub weights: Option<&'a [f64]>,
    /// The exponent γ of curvature^γ.
    pub curvature_exponent: Option<f64>,
}

/// The density of every face, upload order.
#[derive(Debug)]
pub struct Density {
    /// Relative to the largest: 0 ..= 1.
    pub of_face: Vec<f64>,
    /// The largest.
    pub unit: f64,
}

impl Density {
    /// The density of a mesh, if there is one. Weights must be one a face or one a vertex, finite and above 0.
    pub fn of(mesh: MeshView<'_>, weld: &Weld, frame: &Frame, wanted: Wanted<'_>) -> Result<Option<Self>> {
        if wanted == Wanted::default() {
            return Ok(None);
        }
        let mut density = match wanted.weights {
            Some(weights) => Self::of_weights(mesh, weights)?,
            None => Self { of_face: vec![1.0; mesh.faces.len()], unit: 1.0 },
        };
        if let Some(exponent) = wanted.curvature_exponent {
            let geometry = frame.faces(mesh, |_| None);
            let squared = curvature::squared_curvatures(mesh, weld, frame, &geometry);
            for (density, factor) in density.of_face.iter_mut().zip(factors(&squared, &geometry, exponent)) {
                *density *= factor;
            }
            density.normalise();
        }
        Ok(Some(density))
    }

    fn of_weights(mesh: MeshView<'_>, weights: &[f64]) -> Result<Self> {
        let (faces, vertices) = (mesh.faces.len(), mesh.positions.len());
        if weights.len() != faces && weights.len() != vertices {
            return Err(Error::parameter(format_args!(
                "there must be one weight a face, {faces}, or one a vertex, {vertices}, not {}",
                weights.len()
            )));
        }
        check(weights)?;
        let largest = weights.iter().copied().fold(0.0, f64::max);
        let of_face = if weights.len() == faces {
            weights.iter().map(|weight| weight / largest).collect()
        } else {
            let mean = |face: usize| {
                let corners = mesh.faces.corners(face);
                let sum: f64 = corners.iter().map(|&corner| weights[corner as usize] / largest).sum();
                sum / corners.len() as f64
            };
            (0..faces).map(mean).collect()
        };
        let mut density = Self { of_face, unit: largest };
        density.normalise();
        Ok(density)
    }

    /// Makes the largest 1. (All are 0 where a far larger weight belongs to a vertex that no face uses: then all count
    /// alike.)
    fn normalise(&mut self) {
        let largest = self.of_face.iter().copied().fold(0.0, f64::max);
        if largest > 0.0 {
            self.of_face.iter_mut().for_each(|density| *density /= largest);
            self.unit *= largest;
        }
    }
}

/// Refuses weights that are not finite and above 0.
pub fn check(weights: &[f64]) -> Result<()> {
    match weights.iter().position(|weight| !(weight.is_finite() && *weight > 0.0)) {
        Some(at) => Err(Error::parameter(format_args!(
            "weights must be finite and above 0; number {at}, counted from 0, is {}",
            weights[at]
        ))),
        None => Ok(()),
    }
}

/// (κ / root mean square of κ)^exponent of each face, from κ².
fn factors(squared: &[f64], geometry: &[FaceGeometry], exponent: f64) -> Vec<f64> {
    let (mut weighted, mut area) = (0.0, 0.0);
    for (squared, face) in squared.iter().zip(geometry) {
        weighted += face.area * squared;
        area += face.area;
    }
    if !(weighted > 0.0 && area > 0.0) {
        return vec![1.0; squared.len()];
    }
    let mean = weighted / area;
    const RANGE: f64 = CURVATURE_RANGE * CURVATURE_RANGE;
    squared.iter().map(|squared| libm::pow((squared / mean).clamp(1.0 / RANGE, RANGE), exponent / 2.0)).collect()
}
