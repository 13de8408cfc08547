//! How a node of the contraction searches for its best edge.
//!
//! A search writes the row and the best edge of its node. Several threads search at a time; their results do not depend
//! on the order, because statuses and ends do not change meanwhile, and a search reads the best edges only of nodes
//! that do not search.

use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;

use super::{Contraction, Edge, Grown, NO_NODE, resolve};
use crate::device::cpu::best_edge;
use crate::device::cpu::clusters::Clusters;
use crate::device::dual_edge::Rank;
use crate::energy::Functional;
use crate::prefetch::{prefetch, with_lookahead};

/// What the searches of grown nodes find about their neighbours.
#[derive(Debug, Default)]
pub(super) struct SearchResult {
    /// Neighbours whose best edge led to a node that merged: each once in all results of a round, in any of them.
    pub(super) lost: Vec<u32>,
    /// Other neighbours and their edges to grown nodes, where these may be better than their best.
    pub(super) offers: Vec<(u32, Edge)>,
}

impl<E: Functional> Contraction<E> {
    /// Whether one edge of a node is better than another.
    pub(super) fn prefers(&self, clusters: &Clusters<E>, node: u32, edge: Edge, than: Edge) -> bool {
        if edge.cost > than.cost * E::ROUGH_MARGIN || than.cost > edge.cost * E::ROUGH_MARGIN {
            return edge.cost < than.cost;
        }
        let rank = |other: u32| Rank::new(best_edge::packed_cost(clusters, node, other), node, other, self.ties);
        rank(edge.other) < rank(than.other)
    }

    fn rough_cost(&self, node: u32, other: u32) -> f32 {
        E::rough_merge_cost(self.nodes[node as usize].end, self.nodes[other as usize].end)
    }

    /// Requests the nodes that some edges lead to.
    fn prefetch_ends(&self, edges: Range<usize>) {
        for edge in &self.edges[edges] {
            prefetch(&self.nodes, Edge::unpacked(edge.load(Relaxed)).other as usize);
        }
    }

    /// Nodes that grew search among the neighbours of both nodes that merged.
    pub(super) fn search_grown(&self, clusters: &Clusters<E>, grown: &[Grown]) -> SearchResult {
        let (nodes, edges, round) = (self.nodes.as_slice(), self.edges.as_slice(), self.round);
        let mut result = SearchResult::default();
        let mut visited = Visited::default();
        for (&Grown { node, ref rows }, ahead) in with_lookahead(grown) {
            if let Some(later) = ahead.stage(2) {
                later.rows.iter().for_each(|row| prefetch(edges, row.start));
            }
            if let Some(later) = ahead.stage(1) {
                later.rows.iter().for_each(|row| self.prefetch_ends(row.clone()));
            }
            let target = &edges[self.rows[node as usize].start..];
            let mut kept = 0;
            let mut best = Edge::NONE;
            visited.begin(rows[0].len() + rows[1].len());
            for edge in rows.iter().flat_map(|row| &edges[row.clone()]) {
                let other = resolve(nodes, Edge::unpacked(edge.load(Relaxed)).other);
                if other == node || !visited.is_new(other) {
                    continue;
                }
                let edge = Edge { other, cost: self.rough_cost(node, other) };
                best = if self.prefers(clusters, node, edge, best) { edge } else { best };
                target[kept].store(edge.packed(), Relaxed);
                kept += 1;
                let its = nodes[other as usize].best();
                if nodes[other as usize].status.grown != round && its != Edge::LOST {
                    if !nodes[its.other as usize].status.is_unchanged_since(its.other, round - 1) {
                        // several searches may find this; the first one reports it
                        if nodes[other as usize].lose_best() {
                            result.lost.push(other);
                        }
                    } else if edge.cost <= its.cost * E::ROUGH_MARGIN {
                        result.offers.push((other, Edge { other: node, ..edge }));
                    }
                }
            }
            self.store_row(node, kept, best);
        }
        result
    }

    /// Nodes that did not grow search in their rows.
    pub(super) fn search_lost(&self, clusters: &Clusters<E>, lost: &[u32]) {
        let (nodes, rows, edges) = (self.nodes.as_slice(), self.rows.as_slice(), self.edges.as_slice());
        let mut visited = Visited::default();
        for (&node, ahead) in with_lookahead(lost) {
            if let Some(&later) = ahead.stage(3) {
                prefetch(rows, later as usize);
            }
            if let Some(&later) = ahead.stage(2) {
                prefetch(edges, rows[later as usize].start);
            }
            if let Some(&later) = ahead.stage(1) {
                self.prefetch_ends(rows[later as usize].edges());
            }
            let row = &rows[node as usize];
            let edges = &edges[row.edges()];
            let mut kept = 0;
            let mut best = Edge::NONE;
            visited.begin(edges.len());
            for at in 0..edges.len() {
                let mut edge = Edge::unpacked(edges[at].load(Relaxed));
                // two unchanged nodes cannot be the same
                if !nodes[edge.other as usize].status.is_unchanged_since(edge.other, row.searched()) {
                    let other = resolve(nodes, edge.other);
                    if !visited.is_new(other) {
                        continue;
                    }
                    edge = Edge { other, cost: self.rough_cost(node, other) };
                }
                best = if self.prefers(clusters, node, edge, best) { edge } else { best };
                edges[kept].store(edge.packed(), Relaxed);
                kept += 1;
            }
            self.store_row(node, kept, best);
        }
    }

    /// Stores the result of a search: the length of the row and the best edge.
    fn store_row(&self, node: u32, edges: usize, best: Edge) {
        self.nodes[node as usize].set_best(best);
        self.rows[node as usize].renew(edges, self.round);
    }
}

/// The nodes that a search has visited: a hash table with at least half of its slots empty.
#[derive(Debug, Default)]
struct Visited {
    slots: Vec<u32>,
    shift: u32,
}

impl Visited {
    /// Clears the table and makes room for so many nodes.
    fn begin(&mut self, at_most: usize) {
        let slots = (2 * at_most).next_power_of_two().max(16);
        self.shift = 32 - slots.trailing_zeros();
        self.slots.clear();
        self.slots.resize(slots, NO_NODE);
    }

    /// Visits a node. Returns whether this is the first time.
    fn is_new(&mut self, node: u32) -> bool {
        // multiples of the golden ratio spread evenly (Knuth, TAOCP 6.4)
        let mut at = (node.wrapping_mul(0x9e37_79b9) >> self.shift) as usize;
        loop {
            match self.slots[at] {
                NO_NODE => {
                    self.slots[at] = node;
                    return true;
                }
                there if there == node => return false,
                _ => at = (at + 1) % self.slots.len(),
            }
        }
    }
}
