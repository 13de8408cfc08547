//! A geodesic sphere: the faces of an icosahedron in equal triangles, pushed out to the sphere.

use glam::DVec3;

use super::Piece;
use crate::mesh::Faces;

/// Unit sphere with the nearest 20·m² faces.
pub fn icosphere(faces: u64) -> Piece {
    let m = ((faces as f64 / 20.0).sqrt().round() as u32).max(1);
    let golden = (1.0 + 5.0f64.sqrt()) / 2.0;
    let corners: Vec<DVec3> = (0..12)
        .map(|vertex| {
            let (axis, sign) = (vertex / 4, |bit: usize| if vertex >> bit & 1 == 0 { 1.0 } else { -1.0 });
            let mut corner = [0.0; 3];
            corner[(axis + 1) % 3] = sign(0);
            corner[(axis + 2) % 3] = sign(1) * golden;
            corner.into()
        })
        .collect();
    let is_edge = |a: usize, b: usize| a != b && corners[a].distance_squared(corners[b]) < 4.5;
    let edges: Vec<[usize; 2]> = pairs().filter(|&[a, b]| is_edge(a, b)).collect();

    // corners, then the inner vertices of each edge from its smaller corner, then those of each triangle
    let mut positions: Vec<[f64; 3]> = corners.iter().map(|&corner| on_sphere(corner)).collect();
    for &[a, b] in &edges {
        positions.extend((1..m).map(|step| between([corners[a], corners[b], corners[a]], [m - step, step, 0])));
    }
    let on_edge = |from: usize, to: usize, step: u32| {
        let ends = [from.min(to), from.max(to)];
        let edge = edges.iter().position(|&edge| edge == ends).unwrap_or_default() as u32;
        12 + edge * (m - 1) + if from < to { step } else { m - step } - 1
    };
    let mut triangles = Vec::with_capacity(60 * (m * m) as usize);
    for [a, b, c] in edges.iter().flat_map(|&[a, b]| (b + 1..12).map(move |c| [a, b, c])) {
        if !(is_edge(a, c) && is_edge(b, c)) {
            continue;
        }
        let [a, b, c] = if is_outward([corners[a], corners[b], corners[c]]) { [a, b, c] } else { [a, c, b] };
        let inside = positions.len() as u32;
        let mut row_starts = vec![inside; 2];
        for j in 1..m {
            positions.extend((1..m - j).map(|i| between([corners[a], corners[b], corners[c]], [m - i - j, i, j])));
            row_starts.push(positions.len() as u32);
        }
        // i steps from a to b, j from a to c
        let vertex = |i: u32, j: u32| match (i, j) {
            (0, 0) => a as u32,
            (i, 0) if i == m => b as u32,
            (0, j) if j == m => c as u32,
            (i, 0) => on_edge(a, b, i),
            (0, j) => on_edge(a, c, j),
            (i, j) if i + j == m => on_edge(b, c, j),
            (i, j) => row_starts[j as usize] + i - 1,
        };
        for j in 0..m {
            for i in 0..m - j {
                triangles.extend([vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)]);
                if i + j + 1 < m {
                    triangles.extend([vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)]);
                }
            }
        }
    }
    Piece { positions, faces: Faces::from_triangles(triangles) }
}

/// All pairs of corners.
fn pairs() -> impl Iterator<Item = [usize; 2]> {
    (0..12).flat_map(|a| (a + 1..12).map(move |b| [a, b]))
}

/// The point with these barycentric weights, on the sphere.
fn between([a, b, c]: [DVec3; 3], weights: [u32; 3]) -> [f64; 3] {
    let [p, q, r] = weights.map(f64::from);
    on_sphere(p * a + q * b + r * c)
}

fn on_sphere(point: DVec3) -> [f64; 3] {
    (point / point.length()).to_array()
}

/// Whether the corners go counter-clockwise seen from outside.
fn is_outward([a, b, c]: [DVec3; 3]) -> bool {
    a.dot(b.cross(c)) > 0.0
}
