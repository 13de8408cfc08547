//! Compressed rows: lists of numbers, one list after the other.

/// Rows of numbers, such as the neighbours of each item.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rows {
    /// Where each row begins in `items`, and the end of the last: rows + 1 numbers.
    pub offsets: Vec<u32>,
    /// The numbers of all rows.
    pub items: Vec<u32>,
}

impl Rows {
    /// The numbers of a row.
    #[inline]
    pub fn of(&self, row: u32) -> &[u32] {
        let row = row as usize;
        &self.items[self.offsets[row] as usize..self.offsets[row + 1] as usize]
    }

    /// How many rows there are.
    pub fn count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// So many rows without numbers.
    pub fn empty(rows: usize) -> Self {
        Self { offsets: vec![0; rows + 1], items: Vec::new() }
    }

    /// Adds a row.
    pub fn push(&mut self, row: impl IntoIterator<Item = u32>) {
        self.items.extend(row);
        self.offsets.push(self.items.len() as u32);
    }

    /// Row r has the items i, ascending, for which `row_of` has r, a number below `rows`.
    pub(crate) fn grouped(row_of: &[u32], rows: usize) -> Self {
        let mut offsets = vec![0; rows + 1];
        row_of.iter().for_each(|&row| offsets[row as usize + 1] += 1);
        (0..rows).for_each(|row| offsets[row + 1] += offsets[row]);
        let mut next = offsets.clone();
        let mut items = vec![0; row_of.len()];
        for (item, &row) in (0..).zip(row_of) {
            let at = &mut next[row as usize];
            items[*at as usize] = item;
            *at += 1;
        }
        Self { offsets, items }
    }

    /// The rows of pieces, one after the other. The offsets of a piece lack the end of its last row.
    pub(crate) fn joined(pieces: Vec<Self>) -> Self {
        let mut rows = Self {
            offsets: Vec::with_capacity(pieces.iter().map(|piece| piece.offsets.len()).sum::<usize>() + 1),
            items: Vec::with_capacity(pieces.iter().map(|piece| piece.items.len()).sum()),
        };
        for piece in pieces {
            let first = rows.items.len() as u32;
            rows.offsets.extend(piece.offsets.iter().map(|offset| first + offset));
            rows.items.extend(piece.items);
        }
        rows.offsets.push(rows.items.len() as u32);
        rows
    }
}

/// Both ends of every edge as neighbours of each other, once each, in ascending order. There are at most 2³¹ − 1 edges,
/// and the same ones each time; no end is the other.
pub fn symmetric<E: Iterator<Item = (u32, u32)>>(items: usize, edges: impl Fn() -> E) -> Rows {
    // counts, then where each row begins, then where it ends
    let mut ends = vec![0u32; items + 1];
    for (a, b) in edges() {
        ends[a as usize + 1] += 1;
        ends[b as usize + 1] += 1;
    }
    (1..ends.len()).for_each(|item| ends[item] += ends[item - 1]);
    let mut offsets = ends.clone();
    let mut neighbours = vec![0u32; offsets[items] as usize];
    for (a, b) in edges() {
        for (item, other) in [(a, b), (b, a)] {
            let end = &mut ends[item as usize];
            neighbours[*end as usize] = other;
            *end += 1;
        }
    }
    // rows become shorter, so that each moves to the front
    let mut kept = 0;
    for item in 0..items {
        let row = offsets[item] as usize..ends[item] as usize;
        offsets[item] = kept as u32;
        neighbours[row.clone()].sort_unstable();
        let first = kept;
        for at in row {
            if kept == first || neighbours[kept - 1] != neighbours[at] {
                neighbours[kept] = neighbours[at];
                kept += 1;
            }
        }
    }
    offsets[items] = kept as u32;
    neighbours.truncate(kept);
    neighbours.shrink_to_fit();
    Rows { offsets, items: neighbours }
}
