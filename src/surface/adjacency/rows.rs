//! Links as compressed rows, in internal order.
//!
//! A row has the neighbours of a face by lower and upper end of the shared edge, those across bridges last. The order
//! of a triangle's edges is looked up, not sorted.

use std::sync::atomic::Ordering;

use rayon::prelude::*;

use super::{AHEAD, CHAINED, Links, NONE};
use crate::prefetch::prefetch;
use crate::surface::counts::Counts;

/// Links as compressed rows.
pub struct Rows {
    /// First neighbour of each face in `neighbours`, and one past the last.
    pub offsets: Vec<u32>,
    /// Linked faces, internal numbers.
    pub neighbours: Vec<u32>,
    /// Upload faces that are linked to one face more than once.
    pub repeating: Vec<u32>,
}

/// Rows of some faces.
#[derive(Default)]
struct Piece {
    neighbours: Vec<u32>,
    ends: Vec<u32>,
    repeating: Vec<u32>,
}

impl Links<'_> {
    /// The links as compressed rows in internal order.
    pub fn compressed(&self, upload_face: &[u32]) -> Rows {
        /// Faces of a piece.
        const PIECE: usize = 4096;
        let mut internal = vec![0u32; upload_face.len()];
        for (face, &upload) in upload_face.iter().enumerate() {
            internal[upload as usize] = face as u32;
        }
        let internal = &internal[..];
        if self.is_closed() {
            let offsets = (0..=upload_face.len() as u32).map(|face| 3 * face).collect();
            let mut neighbours = vec![0u32; 3 * upload_face.len()];
            let repeating = neighbours
                .par_chunks_mut(3 * PIECE)
                .zip(upload_face.par_chunks(PIECE))
                .flat_map_iter(|(neighbours, faces)| {
                    let mut repeating = Vec::new();
                    let positions = self.edges.positions.as_chunks::<3>().0;
                    let linked = self.linked.as_chunks::<3>().0;
                    for (at, (row, &face)) in neighbours.as_chunks_mut::<3>().0.iter_mut().zip(faces).enumerate() {
                        self.prefetch(&faces[at..], internal);
                        let order = by_ends(positions[face as usize]);
                        let linked = &linked[face as usize];
                        *row = order.map(|corner| internal[linked[corner].load(Ordering::Relaxed) as usize]);
                        let [a, b, c] = *row;
                        if (a == b) | (b == c) | (c == a) {
                            repeating.push(face);
                        }
                    }
                    repeating
                })
                .collect();
            return Rows { offsets, neighbours, repeating };
        }
        let is_plain = self.edges.faces.are_triangles() && self.chained.is_empty() && self.bridges.is_empty();
        let pieces: Vec<Piece> = upload_face
            .par_chunks(PIECE)
            .map(|faces| match is_plain {
                true => self.rows_of_triangles(faces, internal),
                false => self.rows_of_any(faces, internal),
            })
            .collect();
        let mut rows = Rows {
            offsets: Vec::with_capacity(upload_face.len() + 1),
            neighbours: Vec::with_capacity(pieces.iter().map(|piece| piece.neighbours.len()).sum()),
            repeating: Vec::new(),
        };
        rows.offsets.push(0);
        for piece in pieces {
            let first = rows.neighbours.len() as u32;
            rows.offsets.extend(piece.ends.iter().map(|end| first + end));
            rows.neighbours.extend(piece.neighbours);
            rows.repeating.extend(piece.repeating);
        }
        rows
    }

    /// Whether every face has exactly three neighbours, one for each half-edge.
    fn is_closed(&self) -> bool {
        let Counts { boundary_edges, non_manifold_edges, degenerate_faces, .. } = self.counts;
        self.edges.faces.are_triangles()
            && boundary_edges + non_manifold_edges + degenerate_faces == 0
            && self.bridges.is_empty()
    }

    /// The faces that `face` is linked to, by lower and upper end of the shared edge, into `row`.
    fn row(&self, face: u32, row: &mut Vec<u32>, edges: &mut Vec<(u32, u32, u32)>) {
        row.clear();
        let first = self.edges.faces.first_corner(face as usize);
        let end = self.edges.faces.first_corner(face as usize + 1);
        let linked = |corner: usize| self.linked[corner].load(Ordering::Relaxed);
        if let &[a, b, c] = &self.edges.positions[first..end] {
            for corner in by_ends([a, b, c]) {
                self.push(first + corner, linked(first + corner), row);
            }
        } else {
            edges.clear();
            self.edges.each_of(first..end, |low, high, corner| edges.push((low, high, corner)));
            edges.sort_unstable();
            for &mut (_, _, corner) in edges {
                self.push(corner as usize, linked(corner as usize), row);
            }
        }
        let bridges = self.bridges.partition_point(|&(other, _)| other < face);
        row.extend(self.bridges[bridges..].iter().take_while(|bridge| bridge.0 == face).map(|bridge| bridge.1));
    }

    fn push(&self, corner: usize, linked: u32, row: &mut Vec<u32>) {
        match linked {
            NONE => {}
            CHAINED => row.extend(self.chain_at(corner as u32)),
            face => row.push(face),
        }
    }

    /// Prefetches for the rows of some of the next triangles: their links, and the numbers whose links were prefetched
    /// before.
    #[inline]
    fn prefetch(&self, next: &[u32], internal: &[u32]) {
        let linked = self.linked.as_chunks::<3>().0;
        if let Some(&later) = next.get(2 * AHEAD) {
            prefetch(self.edges.positions.as_chunks::<3>().0, later as usize);
            prefetch(linked, later as usize);
        }
        if let Some(&later) = next.get(AHEAD) {
            linked[later as usize].iter().for_each(|other| prefetch(internal, other.load(Ordering::Relaxed) as usize));
        }
    }

    /// The rows of faces of at most three neighbours, one a half-edge.
    fn rows_of_triangles(&self, faces: &[u32], internal: &[u32]) -> Piece {
        let positions = self.edges.positions.as_chunks::<3>().0;
        let linked = self.linked.as_chunks::<3>().0;
        let mut piece = Piece { neighbours: vec![0; 3 * faces.len()], ..Piece::default() };
        let mut end = 0;
        for (at, &face) in faces.iter().enumerate() {
            self.prefetch(&faces[at..], internal);
            let first = end;
            for corner in by_ends(positions[face as usize]) {
                let other = linked[face as usize][corner].load(Ordering::Relaxed);
                let is_there = other != NONE;
                piece.neighbours[end] = internal[if is_there { other } else { face } as usize];
                end += usize::from(is_there);
            }
            piece.ends.push(end as u32);
            let repeats = match piece.neighbours[first..end] {
                [a, b] => a == b,
                [a, b, c] => (a == b) | (b == c) | (c == a),
                _ => false,
            };
            if repeats {
                piece.repeating.push(face);
            }
        }
        piece.neighbours.truncate(end);
        piece
    }

    /// The rows of faces of any kind.
    fn rows_of_any(&self, faces: &[u32], internal: &[u32]) -> Piece {
        let mut piece = Piece::default();
        let (mut row, mut edges) = (Vec::new(), Vec::new());
        for &face in faces {
            self.row(face, &mut row, &mut edges);
            piece.neighbours.extend(row.iter().map(|&face| internal[face as usize]));
            piece.ends.push(piece.neighbours.len() as u32);
            row.sort_unstable();
            if row.windows(2).any(|pair| pair[0] == pair[1]) {
                piece.repeating.push(face);
            }
        }
        piece
    }
}

/// The corners of a triangle in the order of the edges that end there, by lower and then by upper position: the edge
/// opposite the largest position comes first. Those of a degenerate triangle come in any order.
#[inline]
fn by_ends([a, b, c]: [u32; 3]) -> [usize; 3] {
    // the edge that ends at a corner lies opposite the next corner
    let rank = [(b < c) as usize + (b < a) as usize, (c < a) as usize + (c < b) as usize];
    const ORDERS: [[usize; 3]; 9] = {
        let mut orders = [[0, 1, 2]; 9];
        let mut all = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let mut at = 0;
        while at < 6 {
            let order = &mut all[at];
            let (mut of_first, mut of_second) = (0, 0);
            let mut place = 0;
            while place < 3 {
                if order[place] == 0 {
                    of_first = place;
                }
                if order[place] == 1 {
                    of_second = place;
                }
                place += 1;
            }
            orders[3 * of_first + of_second] = *order;
            at += 1;
        }
        orders
    };
    ORDERS[3 * rank[0] + rank[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_come_in_the_order_of_their_edges() {
        for corners in [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]] {
            let edge = |corner: usize| {
                let (from, to) = (corners[(corner + 2) % 3], corners[corner]);
                (from.min(to), from.max(to))
            };
            assert!(by_ends(corners).map(edge).is_sorted(), "{corners:?}");
        }
        for corners in [[1, 1, 2], [1, 2, 1], [2, 1, 1], [1, 2, 2], [2, 1, 2], [2, 2, 1], [1, 1, 1]] {
            let mut order = by_ends(corners);
            order.sort_unstable();
            assert_eq!(order, [0, 1, 2], "{corners:?}");
        }
    }
}
