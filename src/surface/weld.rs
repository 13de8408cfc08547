//! Welding: vertices at exactly equal positions become one, so that seams of texture coordinates or normals do not cut
//! the surface. −0 equals 0; there is no tolerance.
//!
//! Only vertices that faces use are looked at. Sorting them takes 16 bytes each, numbering 8 for any vertex.

use super::order::{NUMBER_BITS, sort_by_prefix};
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
    let mut first = first_vertices(mesh);
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
    for vertex in first.iter_mut().filter(|vertex| **vertex != UNUSED) {
        *vertex = numbers[*vertex as usize];
    }
    (Weld { position_of_vertex: first, vertices }, position_of_corner)
}

/// For each vertex that a face uses the first one of those at its position; [`UNUSED`] for all others.
///
/// Vertices are sorted by a hash of their position, because whole numbers sort faster than positions; those of equal
/// hash are sorted by position.
pub fn first_vertices(mesh: MeshView<'_>) -> Vec<u32> {
    let positions = mesh.positions;
    let mut first = vec![UNUSED; positions.len()];
    mesh.faces.all_corners().iter().for_each(|&vertex| first[vertex as usize] = vertex);
    let used = first.iter().filter(|&&vertex| vertex != UNUSED);
    let mut sorted: Vec<u64> = used.map(|&vertex| hash(positions, vertex) << 32 | u64::from(vertex)).collect();
    sort_by_prefix(&mut sorted, NUMBER_BITS);
    let mut by_position = Vec::new();
    for same_hash in sorted.chunk_by(|a, b| a >> 32 == b >> 32).filter(|vertices| vertices.len() > 1) {
        let vertices = same_hash.iter().map(|&entry| entry as u32);
        by_position.clear();
        by_position.extend(vertices.map(|vertex| (bits(positions, vertex), vertex)));
        by_position.sort_unstable();
        for same in by_position.chunk_by(|a, b| a.0 == b.0) {
            same[1..].iter().for_each(|&(_, vertex)| first[vertex as usize] = same[0].1);
        }
    }
    first
}

/// The bits of a position; adding zero turns −0 into 0.
fn bits(positions: Positions<'_>, vertex: u32) -> [u64; 3] {
    positions.at(vertex as usize).map(|coordinate| (coordinate + 0.0).to_bits())
}

/// 32 bits that mix all those of a position. Meshes made so that hashes are equal cost a sort by position.
fn hash(positions: Positions<'_>, vertex: u32) -> u64 {
    const ODD: u64 = 0x9e37_79b9_7f4a_7c15;
    bits(positions, vertex).into_iter().fold(0u64, |hash, bits| (hash.rotate_left(23) ^ bits).wrapping_mul(ODD)) >> 32
}
