//! The search for optimal dual edges (P§5.4).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::changes::Reader;
use super::clusters::Clusters;
use super::frontier::{Frontier, List};
use super::labels::Labels;
use super::sieve::Sieve;
use crate::cluster::dual_edge::{End, Rank, Ties, exact_cost, packed_cost};
use crate::device::FREE;
use crate::surface::DualGraph;

/// Clusters a thread takes at a time.
const CHUNK: usize = 256;

/// Costs that differ by this factor or more have packed costs in the same order: those tell 1 + 2⁻²⁴ apart.
const MARGIN: f64 = 1.0 + 1e-6;

/// The neighbour that each of the given clusters would best merge with, in their order; [`FREE`] for one without neighbours.
pub fn choose(
    graph: &DualGraph,
    labels: &Labels,
    clusters: &Clusters,
    frontier: &mut Frontier,
    living: &[u32],
    ties: Ties,
) -> Vec<u32> {
    frontier.look_at(living, CHUNK, Sieve::default, |others, list| {
        let cluster = list.cluster;
        let own = end(clusters, cluster);
        let rank = |other: u32| Rank::new(price(clusters, cluster, other), cluster, other, ties);
        let (mut best, mut cost) = (FREE, f64::INFINITY);
        find_neighbours(graph, labels, list, others);
        for &other in others.kept() {
            let about = own.cost_about(end(clusters, other));
            // packed costs are for those that are nearly the same
            if about <= cost * MARGIN && other != best && (about * MARGIN < cost || rank(other) < rank(best)) {
                (best, cost) = (other, about);
            }
        }
        best
    })
}

/// The packed cost of merging two clusters.
pub fn price(clusters: &Clusters, cluster: u32, other: u32) -> u32 {
    packed_cost(end(clusters, cluster), end(clusters, other), clusters.energy_shift(cluster))
}

/// Slots for neighbours that were found lately.
const LATELY: usize = 16;

/// The clusters beside the faces of a list; one that shares several dual edges with them maybe several times. They are put into
/// `others`, in place of whatever was there. Faces beside none are dropped from the list.
fn find_neighbours(graph: &DualGraph, labels: &Labels, list: List<'_>, others: &mut Sieve) {
    let cluster = list.cluster;
    others.clear();
    list.retain(|face| {
        let beside = graph.neighbours_of(face);
        let before = others.kept().len();
        others.add(beside.len(), beside.iter().map(|&near| labels.near_boundary(near)), |other| other != cluster);
        others.kept().len() > before
    });
    // none of those that are found
    let mut lately = [cluster; LATELY];
    others.retain(|other| std::mem::replace(&mut lately[other as usize % LATELY], other) != other);
}

fn end(clusters: &Clusters, cluster: u32) -> End {
    End { weight: clusters.sums(cluster).weight as u64, proxy: clusters.proxy(cluster) }
}

/// A queue of all dual edges, the cheapest first. An edge of a cluster that has changed since it was queued is stale:
/// it is skipped when it comes up, and all edges of changed clusters are queued anew.
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
    pub fn cheapest(
        &mut self,
        graph: &DualGraph,
        labels: &Labels,
        clusters: &mut Clusters,
        frontier: &mut Frontier,
    ) -> Option<Rank<u128>> {
        let changed = clusters.take_changes(Reader::DualEdges);
        for &cluster in &changed {
            self.versions[cluster as usize] += 1;
        }
        let mut others = Sieve::default();
        for &cluster in changed.iter().filter(|&&cluster| clusters.sums(cluster).faces > 0) {
            find_neighbours(graph, labels, frontier.list_of(cluster), &mut others);
            others.kept_mut().sort_unstable();
            for other in others.kept().chunk_by(|a, b| a == b).map(|equal| equal[0]) {
                // an edge between two changed clusters is queued once
                if other < cluster && changed.binary_search(&other).is_ok() {
                    continue;
                }
                let cost = exact_cost(end(clusters, cluster), end(clusters, other)) << clusters.energy_shift(cluster);
                let rank = Rank::new(cost, cluster.min(other), cluster.max(other), self.ties);
                self.edges.push(Reverse(Entry { rank, versions: self.versions_of(rank) }));
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

    fn versions_of(&self, rank: Rank<u128>) -> [u32; 2] {
        let (low, high) = rank.ends();
        [self.versions[low as usize], self.versions[high as usize]]
    }
}

impl Entry {
    fn is_current(&self, versions: &[u32]) -> bool {
        let (low, high) = self.rank.ends();
        self.versions == [versions[low as usize], versions[high as usize]]
    }
}
