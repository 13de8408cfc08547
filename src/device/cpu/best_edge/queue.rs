//! A queue of all dual edges (Kurita 1991), the cheapest first: for one merge at a time.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::boundary::find_neighbours;
use super::end;
use crate::device::cpu::Partition;
use crate::device::cpu::change_log::Cursor;
use crate::device::dual_edge::{Rank, Ties};
use crate::energy::{Functional, Sums};

/// All dual edges. When a cluster changes, its edges are queued anew, and the old entries are skipped when they come
/// up.
#[derive(Debug)]
pub struct Queue {
    edges: BinaryHeap<Reverse<Entry>>,
    /// How often each cluster has changed.
    versions: Vec<u32>,
    ties: Ties,
    /// Entries after the last sweep of stale ones.
    swept: usize,
}

/// A dual edge, its cost in units of the finest component, and the versions of its ends when it was queued.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    rank: Rank<u128>,
    versions: [u32; 2],
}

impl Queue {
    /// An empty queue.
    pub fn new(clusters: usize, ties: Ties) -> Self {
        Self { edges: BinaryHeap::new(), versions: vec![0; clusters], ties, swept: 0 }
    }

    /// The cheapest dual edge of all, which stays in the queue.
    pub fn cheapest<E: Functional>(&mut self, partition: &mut Partition<'_, E>) -> Option<Rank<u128>> {
        let Partition { graph, labels, clusters, boundary } = partition;
        let changed = clusters.change_log.take(Cursor::DualEdges);
        for &cluster in &changed {
            self.versions[cluster as usize] += 1;
        }
        let mut others = Vec::new();
        for &cluster in changed.iter().filter(|&&cluster| clusters.sums(cluster).faces() > 0) {
            find_neighbours(graph, labels, boundary.list_of(cluster), &mut others);
            others.sort_unstable();
            for other in others.chunk_by(|a, b| a == b).map(|equal| equal[0]) {
                // an edge between two changed clusters is queued once
                if other < cluster && changed.binary_search(&other).is_ok() {
                    continue;
                }
                let cost =
                    E::merge_cost(end(clusters, cluster), end(clusters, other)) << clusters.energy_shift(cluster);
                let rank = Rank::new(cost, cluster.min(other), cluster.max(other), self.ties);
                self.edges.push(Reverse(Entry { rank, versions: versions_of(&self.versions, rank) }));
            }
        }
        if self.edges.len() > 2 * self.swept + 4096 {
            let versions = &self.versions;
            self.edges.retain(|Reverse(entry)| entry.is_current(versions));
            self.swept = self.edges.len();
        }
        while let Some(Reverse(entry)) = self.edges.peek() {
            if entry.is_current(&self.versions) {
                return Some(entry.rank);
            }
            self.edges.pop();
        }
        None
    }
}

impl Entry {
    fn is_current(&self, versions: &[u32]) -> bool {
        self.versions == versions_of(versions, self.rank)
    }
}

/// The versions of the ends of an edge.
fn versions_of(versions: &[u32], rank: Rank<u128>) -> [u32; 2] {
    let (low, high) = rank.ends();
    [versions[low as usize], versions[high as usize]]
}
