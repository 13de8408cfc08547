//! Grids of triangles, flat or rolled up: what most shapes are made of.

use crate::mesh::Faces;

/// Numbers of cells (u, v) of a grid with close to `faces` triangles, two a cell, u/v near `aspect`.
pub fn cells(faces: u64, aspect: f64, fewest: [u64; 2]) -> [u64; 2] {
    let cells = faces as f64 / 2.0;
    let v = ((cells / aspect).sqrt().round() as u64).max(fewest[1]);
    let u = ((cells / v as f64).round() as u64).max(fewest[0]);
    [u, v]
}

/// Triangles of a grid that is closed both ways: vertex (i, j) is `i·v + j`.
pub fn closed_faces([u, v]: [u64; 2]) -> Faces {
    let vertex = |i: u64, j: u64| ((i % u) * v + j % v) as u32;
    let mut corners = Vec::with_capacity((6 * u * v) as usize);
    for i in 0..u {
        for j in 0..v {
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            corners.extend([a, b, c, a, c, d]);
        }
    }
    Faces::from_triangles(corners)
}

/// Triangles of a grid with a border: vertex (i, j) is `i·(v + 1) + j`. Cells for which `flip` holds are cut along the
/// other diagonal.
pub fn open_faces([u, v]: [u64; 2], flip: impl Fn(u64, u64) -> bool) -> Faces {
    let vertex = |i: u64, j: u64| (i * (v + 1) + j) as u32;
    let mut corners = Vec::with_capacity((6 * u * v) as usize);
    for i in 0..u {
        for j in 0..v {
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            if flip(i, j) {
                corners.extend([a, b, d, b, c, d]);
            } else {
                corners.extend([a, b, c, a, c, d]);
            }
        }
    }
    Faces::from_triangles(corners)
}

/// Sine and cosine of `turns` full turns.
pub fn sin_cos(turns: f64) -> (f64, f64) {
    let angle = turns * std::f64::consts::TAU;
    (libm::sin(angle), libm::cos(angle))
}
