//! Flat shapes of exactly equal triangles, where every choice is a tie.

use super::Piece;
use super::patch::{cells, open_faces};
use crate::mesh::Faces;

/// Rectangle of unit squares, each cut along the same diagonal, with close to `faces` triangles.
pub fn plane(faces: u64) -> Piece {
    let [u, v] = cells(faces, 1.0, [1, 1]);
    let positions = (0..=u).flat_map(|i| (0..=v).map(move |j| [i as f64, j as f64, 0.0])).collect();
    Piece { positions, faces: open_faces([u, v], |_, _| false) }
}

/// Row of exactly `faces` triangles of edge 1, along the x axis.
pub fn strip(faces: u64) -> Piece {
    // From the middle, x = i/2 stays exact in f32 up to 2²⁵ faces.
    let middle = (faces / 2) as f64;
    let height = 3.0_f64.sqrt() / 2.0;
    let positions = (0..faces + 2).map(|i| [(i as f64 - middle) / 2.0, (i % 2) as f64 * height, 0.0]).collect();
    let mut corners = Vec::with_capacity(3 * faces as usize);
    for i in 0..faces as u32 {
        corners.extend(if i % 2 == 0 { [i, i + 2, i + 1] } else { [i, i + 1, i + 2] });
    }
    Piece { positions, faces: Faces::from_triangles(corners) }
}
