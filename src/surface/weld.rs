//! Welding: vertices at exactly equal positions become one, so that seams of texture coordinates or normals do not cut
//! the surface. −0 equals 0; there is no tolerance.

use rayon::prelude::*;

use crate::mesh::PolygonMesh;

/// For each vertex of the mesh the number of its position, counted in the order in which faces first use them.
#[derive(Debug)]
pub struct Weld {
    /// One number a stored vertex; [`UNUSED`] where no face uses its position.
    pub position_of_vertex: Vec<u32>,
    /// Number of distinct positions that faces use.
    pub vertices: u32,
}

/// The number of a vertex whose position no face uses.
pub const UNUSED: u32 = u32::MAX;

/// Welds the vertices that faces use; also gives the number of the position of each corner, face after face.
pub fn weld(mesh: &PolygonMesh) -> (Weld, Vec<u32>) {
    let first = first_vertices(&mesh.positions);
    let mut numbers = vec![UNUSED; first.len()];
    let mut vertices = 0;
    let position_of_corner = mesh.faces.all_corners().iter().map(|&vertex| {
        let number = &mut numbers[first[vertex as usize] as usize];
        if *number == UNUSED {
            *number = vertices;
            vertices += 1;
        }
        *number
    });
    let position_of_corner = position_of_corner.collect();
    let position_of_vertex = first.into_iter().map(|vertex| numbers[vertex as usize]).collect();
    (Weld { position_of_vertex, vertices }, position_of_corner)
}

/// For each vertex the first one at its position.
pub fn first_vertices(positions: &[[f64; 3]]) -> Vec<u32> {
    // adding zero turns −0 into 0
    let bits = |position: &[f64; 3]| position.map(|coordinate| (coordinate + 0.0).to_bits());
    let mut sorted: Vec<([u64; 3], u32)> =
        positions.par_iter().enumerate().map(|(vertex, position)| (bits(position), vertex as u32)).collect();
    sorted.par_sort_unstable();
    let mut first: Vec<u32> = (0..positions.len() as u32).collect();
    for same in sorted.chunk_by(|a, b| a.0 == b.0) {
        same[1..].iter().for_each(|&(_, vertex)| first[vertex as usize] = same[0].1);
    }
    first
}
