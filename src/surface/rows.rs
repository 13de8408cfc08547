//! Neighbours as compressed rows, made of edges.

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
    Rows { offsets, neighbours }
}
