//! Welding: vertices at exactly equal positions become one, so that seams of texture coordinates or normals do not cut
//! the surface. −0 equals 0; there is no tolerance.
//!
//! Nearly all vertices of most meshes lie alone. So repeated positions are looked for first, by hashing in parts that
//! fit the cache; only where there are any does the numbering look them up.

use std::hash::{BuildHasher, RandomState};
use std::hint::select_unpredictable;

use rayon::prelude::*;

use crate::mesh::{Faces, PolygonMesh};

/// For each vertex of the mesh the number of its position, counted in the order in which faces first use them.
#[derive(Debug)]
pub struct Weld {
    /// One number a stored vertex; [`UNUSED`] where no face uses its position.
    pub position_of_vertex: Vec<u32>,
    /// Number of distinct positions that faces use.
    pub vertices: u32,
    /// Whether there are vertices at positions that no face uses.
    pub has_unused: bool,
}

/// The number of a vertex whose position no face uses.
pub const UNUSED: u32 = u32::MAX;

/// Welds the vertices that faces use, and gives the number of the position of each corner, face after face.
pub fn weld(mesh: &PolygonMesh) -> (Weld, Vec<u32>) {
    let vertices = mesh.positions.len();
    let repeated = repeated(&mesh.positions);
    let mut position_of_vertex = vec![UNUSED; vertices];
    let mut count = 0;
    let position_of_corner = if repeated.is_empty() {
        number(&mesh.faces, &mut position_of_vertex, &mut count, |vertex| vertex)
    } else {
        let mut first: Vec<u32> = (0..vertices as u32).collect();
        for (vertex, earlier) in repeated {
            first[vertex as usize] = earlier;
        }
        let corners = number(&mesh.faces, &mut position_of_vertex, &mut count, |vertex| first[vertex as usize]);
        for vertex in 0..vertices {
            position_of_vertex[vertex] = position_of_vertex[first[vertex] as usize];
        }
        corners
    };
    let has_unused = position_of_vertex.contains(&UNUSED);
    (Weld { position_of_vertex, vertices: count, has_unused }, position_of_corner)
}

/// Numbers the vertices that stand for a position as faces come to them, and gives the numbers of all corners.
fn number(faces: &Faces, numbers: &mut [u32], count: &mut u32, first: impl Fn(u32) -> u32) -> Vec<u32> {
    let corners = faces.all_corners().iter();
    corners
        .map(|&vertex| {
            let number = &mut numbers[first(vertex) as usize];
            let is_first = *number == UNUSED;
            *number = select_unpredictable(is_first, *count, *number);
            *count += u32::from(is_first);
            *number
        })
        .collect()
}

/// Vertices at the position of an earlier one, each with the first at that position.
///
/// Hash tables with linear probing, keyed afresh in every run: no mesh can be prepared whose positions collide. The
/// key decides only where a vertex is kept.
fn repeated(positions: &[[f64; 3]]) -> Vec<(u32, u32)> {
    /// Vertices of a table, about: its slots then take 64 KiB.
    const PART: usize = 4096;
    let random = RandomState::new();
    let keys = [random.hash_one(1u8), random.hash_one(2u8), random.hash_one(3u8) | 1];
    let parts = (positions.len() / PART).next_power_of_two().min(256);
    // larger pieces for larger meshes, so that a piece has some hundred vertices for each part
    let piece = (8 * PART).max(256 * parts);
    let pieces: Vec<Piece> = positions
        .par_chunks(piece)
        .enumerate()
        .map(|(index, positions)| Piece::new(positions, (index * piece) as u32, keys, parts))
        .collect();
    (0..parts)
        .into_par_iter()
        .flat_map_iter(|part| {
            let mut repeated = Vec::new();
            let count: usize = pieces.iter().map(|piece| piece.part(part).len()).sum();
            let mask = (2 * count).next_power_of_two() - 1;
            let mut table = vec![EMPTY; mask + 1];
            for &entry in pieces.iter().flat_map(|piece| piece.part(part)) {
                let mut slot = (entry >> 32) as usize & mask;
                loop {
                    let there = table[slot];
                    if there == EMPTY {
                        table[slot] = entry;
                        break;
                    }
                    if there >> 32 == entry >> 32 {
                        let [first, vertex] = [there, entry].map(|entry| entry as u32);
                        if bits(positions[first as usize]) == bits(positions[vertex as usize]) {
                            repeated.push((vertex, first));
                            break;
                        }
                    }
                    slot = (slot + 1) & mask;
                }
            }
            repeated
        })
        .collect()
}

/// An empty slot; vertices are numbered below 2³² − 1.
const EMPTY: u64 = u64::MAX;

/// A run of vertices, sorted by the part that they belong to.
struct Piece {
    /// Lower half of the hash, and vertex.
    entries: Vec<u64>,
    /// Where each part begins, and the end of the last.
    starts: Vec<u32>,
}

impl Piece {
    fn new(positions: &[[f64; 3]], first: u32, keys: [u64; 3], parts: usize) -> Self {
        let part = |hash: u64| (hash >> 32) as usize & (parts - 1);
        let hashes: Vec<u64> = positions.iter().map(|&position| hash(bits(position), keys)).collect();
        let mut starts = vec![0u32; parts + 1];
        for &hash in &hashes {
            starts[part(hash) + 1] += 1;
        }
        for part in 0..parts {
            starts[part + 1] += starts[part];
        }
        let mut next = starts.clone();
        let mut entries = vec![0; hashes.len()];
        for (vertex, &hash) in (first..).zip(&hashes) {
            let slot = &mut next[part(hash)];
            entries[*slot as usize] = hash << 32 | u64::from(vertex);
            *slot += 1;
        }
        Self { entries, starts }
    }

    /// The entries of a part, by vertex.
    fn part(&self, part: usize) -> &[u64] {
        &self.entries[self.starts[part] as usize..self.starts[part + 1] as usize]
    }
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
