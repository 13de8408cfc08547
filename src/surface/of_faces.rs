//! What energies see of the faces of a mesh.

use glam::DVec3;

use super::items::Units;
use super::lattice::{FaceGeometry, round_centroid};
use crate::energy::{Energy, Functional, Normals};
use crate::mesh::Frame;

/// An energy of the faces of a mesh.
pub trait OfFaces: Functional {
    /// Whether a flat tiling by hexagons is a measure of it.
    const HAS_TILING: bool;

    /// The point of a face with this unit normal, in units of 2^-`exponent`, before it is rounded.
    fn position(face: &FaceGeometry, normal: DVec3) -> Self::Position;

    /// The same on the lattice.
    fn point(face: &FaceGeometry, normal: DVec3) -> Self::Point;

    /// From the lattice to the source.
    fn units(frame: &Frame, weight_exponent: i32, density: f64) -> Units<Self>;
}

impl OfFaces for Energy {
    const HAS_TILING: bool = true;

    fn position(face: &FaceGeometry, _: DVec3) -> [f64; 3] {
        face.centroid.to_array()
    }

    fn point(face: &FaceGeometry, _: DVec3) -> [i32; 3] {
        round_centroid(face.centroid)
    }

    fn units(frame: &Frame, weight_exponent: i32, density: f64) -> Units<Self> {
        Units { centre: frame.centre.to_array(), exponent: frame.exponent, weight_exponent, density }
    }
}

/// Unit normals are multiplied by 2 to this power.
const NORMAL_BITS: i32 = 26;

/// Centroids are divided by 2 to this power, so that they decide only between normals that are nearly equal: in flat
/// parts, where clusters would otherwise grow as stars (`docs/arithmetic.md`).
const CENTROID_BITS: i32 = 13;

impl OfFaces for Normals {
    const HAS_TILING: bool = false;

    /// The unit normal, 0 without area, and the centroid.
    fn position(face: &FaceGeometry, normal: DVec3) -> [f64; 8] {
        let [a, b, c] = (normal * f64::from(1 << NORMAL_BITS)).into();
        let [x, y, z] = (face.centroid / f64::from(1 << CENTROID_BITS)).into();
        [a, b, c, x, y, z, 0.0, 0.0]
    }

    fn point(face: &FaceGeometry, normal: DVec3) -> [i32; 8] {
        Self::position(face, normal).map(|axis| (axis + 0.5).floor() as i32)
    }

    fn units(_: &Frame, weight_exponent: i32, density: f64) -> Units<Self> {
        Units { centre: [0.0; 8], exponent: NORMAL_BITS, weight_exponent, density }
    }
}
