//! A torus.

use super::Piece;
use super::patch::{cells, closed_faces, sin_cos};

/// Torus about the z axis with radii 1 and 0.4 and close to `faces` triangles.
pub fn torus(faces: u64) -> Piece {
    const TUBE: f64 = 0.4;
    let [u, v] = cells(faces, 1.0 / TUBE, [3, 3]);
    let mut positions = Vec::with_capacity((u * v) as usize);
    for i in 0..u {
        let (y, x) = sin_cos(i as f64 / u as f64);
        for j in 0..v {
            let (height, outwards) = sin_cos(j as f64 / v as f64);
            let radius = 1.0 + TUBE * outwards;
            positions.push([radius * x, radius * y, TUBE * height]);
        }
    }
    Piece { positions, faces: closed_faces([u, v]) }
}
