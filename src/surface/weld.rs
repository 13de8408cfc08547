//! Welding: vertices at exactly equal positions become one, so that seams of texture coordinates or normals do not cut
//! the surface. −0 equals 0; there is no tolerance.

use std::hash::{BuildHasher, RandomState};

use crate::mesh::PolygonMesh;

/// For each vertex of the mesh the number of its position, counted in the order in which faces first use them.
#[derive(Debug)]
pub struct Weld {
    /// One number a stored vertex; [`UNUSED`] for vertices that no face uses.
    pub position_of_vertex: Vec<u32>,
    /// Number of distinct positions that faces use.
    pub vertices: u32,
}

/// The number of a vertex that no face uses.
pub const UNUSED: u32 = u32::MAX;

/// Welds the vertices that faces use.
///
/// A hash table with linear probing, keyed afresh in every run: nobody can prepare a mesh whose positions collide. The
/// key decides only where a position is kept, never its number.
pub fn weld(mesh: &PolygonMesh) -> Weld {
    let random = RandomState::new();
    let keys = [random.hash_one(1u8), random.hash_one(2u8), random.hash_one(3u8) | 1];
    let mut position_of_vertex = vec![UNUSED; mesh.positions.len()];
    let mask = (2 * mesh.positions.len()).next_power_of_two() - 1;
    let mut table: Vec<u32> = vec![UNUSED; mask + 1];
    let mut vertices = 0;
    for &vertex in mesh.faces.all_corners() {
        if position_of_vertex[vertex as usize] != UNUSED {
            continue;
        }
        let position = bits(mesh.positions[vertex as usize]);
        let mut slot = hash(position, keys) as usize & mask;
        position_of_vertex[vertex as usize] = loop {
            let first = table[slot];
            if first == UNUSED {
                table[slot] = vertex;
                vertices += 1;
                break vertices - 1;
            }
            if bits(mesh.positions[first as usize]) == position {
                break position_of_vertex[first as usize];
            }
            slot = (slot + 1) & mask;
        };
    }
    Weld { position_of_vertex, vertices }
}

/// The bits of a position; adding zero turns −0 into 0.
fn bits(position: [f64; 3]) -> [u64; 3] {
    position.map(|coordinate| (coordinate + 0.0).to_bits())
}

/// A keyed hash by folded multiplication.
fn hash(position: [u64; 3], keys: [u64; 3]) -> u64 {
    let fold = |a: u64, b: u64| {
        let product = u128::from(a) * u128::from(b);
        product as u64 ^ (product >> 64) as u64
    };
    fold(fold(position[0] ^ keys[0], position[1] ^ keys[1]) ^ position[2], keys[2])
}
