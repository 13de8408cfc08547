//! Meshes that took time in proportion to the square of their faces: for tests, not for the command line.

use super::patch::sin_cos;
use super::{Piece, join};
use crate::mesh::{Faces, PolygonMesh};

/// A cone: a ring of triangles about a tip, closed by one polygon that has all of them as neighbours.
pub fn cone(triangles: u32) -> PolygonMesh {
    let on_ring = |corner: u32| {
        let (y, x) = sin_cos(f64::from(corner) / f64::from(triangles));
        [x, y, 0.0]
    };
    let mut faces = Faces::default();
    (0..triangles).for_each(|corner| faces.push(&[corner, (corner + 1) % triangles, triangles]));
    faces.push(&(0..triangles).rev().collect::<Vec<_>>());
    let positions = (0..triangles).map(on_ring).chain([[0.0, 0.0, 1.0]]).collect();
    join(vec![("cone".to_owned(), Piece { positions, faces })])
}

/// A star: one polygon with a triangle at each edge, which has no other neighbour.
pub fn star(triangles: u32) -> PolygonMesh {
    let at = |turns: f64, radius: f64| {
        let (y, x) = sin_cos(turns / f64::from(triangles));
        [radius * x, radius * y, 0.0]
    };
    let mut faces = Faces::default();
    faces.push(&(0..triangles).collect::<Vec<_>>());
    (0..triangles).for_each(|corner| faces.push(&[corner, triangles + corner, (corner + 1) % triangles]));
    let inner = (0..triangles).map(|corner| at(f64::from(corner), 1.0));
    let outer = (0..triangles).map(|corner| at(f64::from(corner) + 0.5, 1.1));
    let positions = inner.chain(outer).collect();
    join(vec![("star".to_owned(), Piece { positions, faces })])
}

/// Boxes of twelve triangles stacked in one place: around each edge, the faces of two places alternate.
pub fn stacked_boxes(boxes: usize) -> PolygonMesh {
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let corners: Vec<u32> = quads.into_iter().flat_map(|[a, b, c, d]: [u32; 4]| [a, b, c, a, c, d]).collect();
    let positions = (0..8u32).map(|corner| [0, 1, 2].map(|axis| f64::from(corner >> axis & 1))).collect();
    let faces = Faces::from_triangles(corners.repeat(boxes));
    join(vec![("stacked-boxes".to_owned(), Piece { positions, faces })])
}
