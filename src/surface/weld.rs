//! Welding: vertices at exactly equal positions become one, so that seams of texture coordinates or normals do not cut
//! the surface. −0 equals 0; there is no tolerance.
//!
//! Only vertices that faces use are looked at. Sorting them takes 32 bytes each; any other vertex takes 4.

use rayon::prelude::*;

use crate::mesh::{MeshView, Positions};

/// For each vertex of the mesh the number of its position, counted in the order in which faces first use them.
#[derive(Debug)]
pub struct Weld {
    /// One number a stored vertex; [`UNUSED`] where no face uses it.
    pub position_of_vertex: Vec<u32>,
    /// Number of distinct positions that faces use.
    pub vertices: u32,
}

/// The number of a vertex that no face uses.
pub const UNUSED: u32 = u32::MAX;

/// Welds the vertices that faces use; also gives the number of the position of each corner, face after face.
pub fn weld(mesh: MeshView<'_>) -> (Weld, Vec<u32>) {
    let mut position_of_vertex = vec![UNUSED; mesh.positions.len()];
    let corners = mesh.faces.all_corners();
    corners.iter().for_each(|&vertex| position_of_vertex[vertex as usize] = 0);
    let positions = sort(mesh.positions, &mut position_of_vertex);
    // in the order of the positions so far; from here on, in that of the faces
    let mut numbers = vec![UNUSED; positions as usize];
    let mut vertices = 0;
    let position_of_corner = corners.iter().map(|&vertex| {
        let number = &mut numbers[position_of_vertex[vertex as usize] as usize];
        if *number == UNUSED {
            *number = vertices;
            vertices += 1;
        }
        *number
    });
    let position_of_corner = position_of_corner.collect();
    for position in position_of_vertex.iter_mut().filter(|position| **position != UNUSED) {
        *position = numbers[*position as usize];
    }
    (Weld { position_of_vertex, vertices }, position_of_corner)
}

/// Numbers the distinct positions of the vertices that are not [`UNUSED`], in the order of their coordinates' bits;
/// gives their number.
fn sort(positions: Positions<'_>, position_of_vertex: &mut [u32]) -> u32 {
    // adding zero turns −0 into 0
    let bits = |vertex: u32| positions.at(vertex as usize).map(|coordinate| (coordinate + 0.0).to_bits());
    let used = |vertex: &u32| position_of_vertex[*vertex as usize] != UNUSED;
    let used: Vec<u32> = (0..positions.len() as u32).filter(used).collect();
    let mut sorted: Vec<([u64; 3], u32)> = used.into_par_iter().map(|vertex| (bits(vertex), vertex)).collect();
    sorted.par_sort_unstable();
    let mut count = 0;
    for same in sorted.chunk_by(|a, b| a.0 == b.0) {
        same.iter().for_each(|&(_, vertex)| position_of_vertex[vertex as usize] = count);
        count += 1;
    }
    count
}
