//! Links as compressed rows, in internal order: the neighbours of a face by lower and upper end of the shared edge,
//! those across bridges last.

use std::ops::Range;
use std::sync::atomic::Ordering;

use super::{CHAINED, Links, NONE, has_repeated};
use crate::parallel;
use crate::prefetch::{Ahead, prefetch, with_lookahead};
use crate::surface::rows::Rows;

impl Links<'_> {
    /// The links as compressed rows in internal order, which is given in both directions. Also returns the upload faces
    /// that are linked to one face more than once.
    pub fn compressed(&self, upload_face: &[u32], internal: &[u32]) -> (Rows, Vec<u32>) {
        /// Faces of a piece.
        const PIECE: usize = 4096;
        let of_piece = |piece: Range<usize>| self.rows_of(&upload_face[piece], internal);
        let pieces = parallel::pieces(upload_face.len(), PIECE, &of_piece);
        let (rows, repeating): (Vec<_>, Vec<_>) = pieces.into_iter().unzip();
        (Rows::joined(rows), repeating.concat())
    }

    /// The same for some upload faces; the offsets lack the end of the last row.
    fn rows_of(&self, faces: &[u32], internal: &[u32]) -> (Rows, Vec<u32>) {
        let mut rows = Rows { items: Vec::with_capacity(3 * faces.len()), ..Rows::default() };
        let mut repeating = Vec::new();
        let is_plain = self.edges.faces.are_triangles() && self.chained.is_empty() && self.bridges.is_empty();
        let positions = self.edges.positions.as_chunks::<3>().0;
        let linked = self.linked.as_chunks::<3>().0;
        let mut edges = Vec::new();
        for (&face, ahead) in with_lookahead(faces) {
            self.prefetch(ahead, internal);
            let first = rows.items.len();
            rows.offsets.push(first as u32);
            let mut push = |other: u32| rows.items.push(internal[other as usize]);
            if is_plain {
                let of_face = &linked[face as usize];
                let others = by_ends(positions[face as usize]).map(|corner| of_face[corner].load(Ordering::Relaxed));
                others.into_iter().filter(|&other| other != NONE).for_each(push);
            } else {
                edges.clear();
                self.edges.each_of(face as usize, |low, high, corner| edges.push((low, high, corner)));
                edges.sort_unstable();
                for &(_, _, corner) in &edges {
                    match self.linked[corner as usize].load(Ordering::Relaxed) {
                        NONE => {}
                        CHAINED => self.chain_at(corner).into_iter().for_each(&mut push),
                        other => push(other),
                    }
                }
                let bridges = self.bridges.partition_point(|&(other, _)| other < face);
                self.bridges[bridges..].iter().take_while(|bridge| bridge.0 == face).for_each(|bridge| push(bridge.1));
            }
            if has_repeated(&rows.items[first..]) {
                repeating.push(face);
            }
        }
        (rows, repeating)
    }

    /// Requests what the rows of later faces read: their corners and links, and then the numbers of linked faces.
    #[inline]
    fn prefetch(&self, ahead: Ahead<'_, u32>, internal: &[u32]) {
        let corners = |&face: &u32| self.edges.faces.corner_range(face as usize);
        if let Some(later) = ahead.stage(4).map(corners) {
            prefetch(&self.edges.positions, later.start);
            prefetch(&self.linked, later.start);
        }
        if let Some(later) = ahead.stage(2).map(corners) {
            self.linked[later].iter().for_each(|other| prefetch(internal, other.load(Ordering::Relaxed) as usize));
        }
    }
}

/// The corners of a triangle in the order of the edges that end there, by lower and then by upper position: the edge
/// opposite the largest position comes first. Those of a degenerate triangle come in any order.
#[inline]
fn by_ends([a, b, c]: [u32; 3]) -> [usize; 3] {
    /// By the places of the first and of the second corner.
    static ORDERS: [[usize; 3]; 9] =
        [[0, 1, 2], [0, 1, 2], [0, 2, 1], [1, 0, 2], [0, 1, 2], [2, 0, 1], [1, 2, 0], [2, 1, 0], [0, 1, 2]];
    // the edge that ends at a corner lies opposite the next corner
    let places = [(b < c) as usize + (b < a) as usize, (c < a) as usize + (c < b) as usize];
    ORDERS[3 * places[0] + places[1]]
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
