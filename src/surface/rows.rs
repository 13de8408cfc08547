//! Neighbours as compressed rows, made of edges.

use rayon::prelude::*;

/// The neighbours of each item.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rows {
    /// First neighbour of each item in `neighbours`, and one past the last: items + 1 numbers.
    pub offsets: Vec<u32>,
    /// Neighbours, those of an item one after the other.
    pub neighbours: Vec<u32>,
}

impl Rows {
    /// The neighbours of an item.
    #[inline]
    pub fn of(&self, item: u32) -> &[u32] {
        let item = item as usize;
        &self.neighbours[self.offsets[item] as usize..self.offsets[item + 1] as usize]
    }
}

/// Both ends of every edge as neighbours of each other, once each, in ascending order. There are at most 2³¹ − 1 edges,
/// and the same ones each time; no end is the other.
pub fn symmetric<E: Iterator<Item = (u32, u32)>>(items: usize, edges: impl Fn() -> E) -> Rows {
    /// Items of a piece.
    const PIECE: usize = 4096;
    // counts, then where each row begins, then where it ends
    let mut ends = vec![0u32; items + 1];
    for (a, b) in edges() {
        ends[a as usize + 1] += 1;
        ends[b as usize + 1] += 1;
    }
    (1..ends.len()).for_each(|item| ends[item] += ends[item - 1]);
    let starts = ends.clone();
    let mut listed = vec![0u32; *starts.last().unwrap_or(&0) as usize];
    for (a, b) in edges() {
        for (item, other) in [(a, b), (b, a)] {
            let end = &mut ends[item as usize];
            listed[*end as usize] = other;
            *end += 1;
        }
    }
    let mut pieces: Vec<(&[u32], &mut [u32])> = Vec::with_capacity(items.div_ceil(PIECE));
    let mut rest = &mut listed[..];
    for first in (0..items).step_by(PIECE) {
        let rows = &starts[first..=(first + PIECE).min(items)];
        let (piece, others) = std::mem::take(&mut rest).split_at_mut((rows[rows.len() - 1] - rows[0]) as usize);
        pieces.push((rows, piece));
        rest = others;
    }
    let shortened: Vec<(Vec<u32>, Vec<u32>)> =
        pieces.into_par_iter().map(|(rows, listed)| unique(rows, listed)).collect();
    let mut offsets = Vec::with_capacity(items + 1);
    let mut neighbours = Vec::with_capacity(shortened.iter().map(|(_, neighbours)| neighbours.len()).sum());
    for (of_piece, listed) in shortened {
        offsets.extend(of_piece.iter().map(|offset| offset + neighbours.len() as u32));
        neighbours.extend(listed);
    }
    offsets.push(neighbours.len() as u32);
    Rows { offsets, neighbours }
}

/// Rows with each neighbour once, in order: where each begins, and the neighbours.
fn unique(rows: &[u32], listed: &mut [u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut offsets, mut neighbours) = (Vec::with_capacity(rows.len()), Vec::with_capacity(listed.len() / 2));
    for row in rows.windows(2) {
        offsets.push(neighbours.len() as u32);
        let row = &mut listed[(row[0] - rows[0]) as usize..(row[1] - rows[0]) as usize];
        row.sort_unstable();
        neighbours.extend(row.chunk_by(|a, b| a == b).map(|same| same[0]));
    }
    (offsets, neighbours)
}
