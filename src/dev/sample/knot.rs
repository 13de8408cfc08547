//! A trefoil knot with bumps: closed, curved everywhere, triangles of different sizes.

use glam::DVec3;

use super::Piece;
use super::patch::{cells, closed_faces, sin_cos};

/// Trefoil knot with close to `faces` triangles, some 6 units wide.
///
/// The centre line winds twice around the z axis and three times around a torus; the normal of that torus is always
/// perpendicular to it and closes with it, so it serves as the frame of the tube.
pub fn knot(faces: u64) -> Piece {
    const TUBE: f64 = 0.6;
    const LENGTH_OVER_GIRTH: f64 = 8.5;
    let [u, v] = cells(faces, LENGTH_OVER_GIRTH, [12, 3]);
    let mut positions = Vec::with_capacity((u * v) as usize);
    for i in 0..u {
        let turns = i as f64 / u as f64;
        let (sin2, cos2) = sin_cos(2.0 * turns);
        let (sin3, cos3) = sin_cos(3.0 * turns);
        let radius = 2.0 + cos3;
        let centre = DVec3::new(radius * cos2, radius * sin2, sin3);
        let tangent =
            DVec3::new(-3.0 * sin3 * cos2 - 2.0 * radius * sin2, -3.0 * sin3 * sin2 + 2.0 * radius * cos2, 3.0 * cos3);
        let normal = DVec3::new(cos3 * cos2, cos3 * sin2, sin3);
        let binormal = normal.cross(tangent / tangent.length());
        for j in 0..v {
            let around = j as f64 / v as f64;
            let (sin, cos) = sin_cos(around);
            let bump = sin_cos(36.0 * turns).0 * sin_cos(4.0 * around).0;
            let tube = TUBE * (1.0 + 0.12 * bump);
            positions.push((centre + tube * (cos * normal + sin * binormal)).to_array());
        }
    }
    Piece { positions, faces: closed_faces([u, v]) }
}
