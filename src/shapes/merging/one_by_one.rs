//! Merges one at a time, always the cheapest.
//!
//! The cheapest edges are in a heap, the others in a list, which is not in order. When the heap is empty, the cheapest
//! part of the list becomes the heap. So the heap stays small, which doubles the speed.
//!
//! # Work
//!
//! A merge prices the edges of the cluster that it makes. Meshes take some 10 prices an edge. Where clusters have very
//! many neighbours, as around holes that are polygons, it is more: after [`LOOKS_AN_EDGE`] prices an edge, on average,
//! the queue is exhausted.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::{Edge, LOOKS_AN_EDGE, Merging, Union};
use crate::error::Error;
use crate::parallel;

/// Neighbours that a thread prices at a time, at least.
const PRICES_A_THREAD: usize = 64;

/// The part of the list that becomes the heap, and edges that are not worth a part.
const PART: usize = 16;
const FEW: usize = 256;

/// An edge and the time of its price. It is outdated if one of its clusters has changed since.
type Priced = (Edge, u32);

/// The edges between clusters, the cheapest first.
pub(super) struct Queue {
    heap: BinaryHeap<Reverse<Priced>>,
    /// Those above the limit.
    others: Vec<Priced>,
    limit: Option<Edge>,
    /// The clusters beside each one, by numbers that they have or had.
    beside: Vec<Vec<u32>>,
    changed_at: Vec<u32>,
    time: u32,
    looks_left: usize,
}

impl Queue {
    /// Of all edges between clusters.
    pub fn new(merging: &Merging<'_>, edges: Vec<Edge>) -> Self {
        let clusters = merging.parts.len();
        let mut beside = vec![Vec::new(); clusters];
        for (low, high) in edges.iter().map(Edge::ends) {
            beside[low as usize].push(high);
            beside[high as usize].push(low);
        }
        let looks_left = LOOKS_AN_EDGE * edges.len();
        let others = edges.into_iter().map(|edge| (edge, 0)).collect();
        let changed_at = vec![0; clusters];
        Self { heap: BinaryHeap::new(), others, limit: None, beside, changed_at, time: 0, looks_left }
    }

    /// Whether there were too many prices.
    pub fn is_exhausted(&self) -> bool {
        self.looks_left == 0
    }

    /// The edges that are left.
    pub fn edges(self, merging: &Merging<'_>) -> Vec<Edge> {
        let Self { heap, others, changed_at, .. } = self;
        let all = heap.into_iter().map(|Reverse(priced)| priced).chain(others);
        all.filter(|priced| is_current(merging, &changed_at, priced)).map(|(edge, _)| edge).collect()
    }

    /// Takes the cheapest edge out.
    pub fn pop(&mut self, merging: &Merging<'_>) -> Option<Edge> {
        loop {
            while let Some(Reverse(priced)) = self.heap.pop() {
                if is_current(merging, &self.changed_at, &priced) {
                    return Some(priced.0);
                }
            }
            let Self { heap, others, limit, changed_at, .. } = self;
            others.retain(|priced| is_current(merging, changed_at, priced));
            let last = (others.len() / PART).max(FEW).min(others.len()).checked_sub(1)?;
            *limit = Some(others.select_nth_unstable(last).1.0);
            heap.extend(others.drain(..=last).map(Reverse));
        }
    }

    /// Prices the edges of a cluster that two have become. No face must have moved.
    pub fn merged(&mut self, merging: &mut Merging<'_>, union: &Union) {
        let [mut all, mut others] = [union.into, union.from].map(|end| std::mem::take(&mut self.beside[end as usize]));
        if others.len() > all.len() {
            std::mem::swap(&mut all, &mut others);
        }
        all.append(&mut others);
        all.iter_mut().for_each(|near| *near = merging.root(*near));
        all.sort_unstable();
        all.dedup();
        all.retain(|&near| near != union.into);
        self.changed(merging, &[union.into], |_| all.clone());
        self.beside[union.into as usize] = all;
    }

    /// Prices the edges of clusters that changed, given the clusters beside each one.
    pub fn changed(&mut self, merging: &Merging<'_>, changed: &[u32], beside: impl Fn(u32) -> Vec<u32>) {
        self.time += 1;
        for &cluster in changed {
            self.changed_at[cluster as usize] = self.time;
        }
        let ends = |cluster: u32| {
            let pair = move |near: u32| (cluster.min(near), cluster.max(near));
            beside(cluster).into_iter().map(pair)
        };
        let mut pairs: Vec<(u32, u32)> = changed.iter().flat_map(|&cluster| ends(cluster)).collect();
        pairs.sort_unstable();
        pairs.dedup();
        self.looks_left = self.looks_left.saturating_sub(pairs.len());
        let price = |pair| (merging.edge(pairs[pair]), self.time);
        let priced: Vec<Priced> = parallel::map(pairs.len(), PRICES_A_THREAD, price);
        for priced in priced {
            match self.limit {
                Some(limit) if priced.0 <= limit => self.heap.push(Reverse(priced)),
                _ => self.others.push(priced),
            }
        }
    }
}

/// The error for a queue that is empty while clusters are to merge.
pub(super) fn no_edge() -> Error {
    Error::internal("there is no dual edge left to collapse")
}

/// Whether both clusters are as they were when the edge was priced.
fn is_current(merging: &Merging<'_>, changed_at: &[u32], &(edge, time): &Priced) -> bool {
    let (low, high) = edge.ends();
    [low, high].iter().all(|&end| merging.into[end as usize] == end && changed_at[end as usize] <= time)
}
