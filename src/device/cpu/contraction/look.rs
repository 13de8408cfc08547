//! How a node of the contraction looks for its best dual edge.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::{Edge, Grown, MARGIN, NOBODY, Node, Row, living};
use crate::cluster::dual_edge::{Rank, Ties};
use crate::device::cpu::clusters::Clusters;
use crate::device::cpu::dual_edges;
use crate::prefetch::{prefetch, with_lookahead};

/// What a look for the best dual edge reads. It writes the row and the best edge of who looks. Several threads look at a time; what
/// they find does not depend on who comes first, because fates and ends stand still meanwhile, and best edges are read of nodes that
/// do not look.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub(super) nodes: &'a [Node],
    pub(super) rows: &'a [Row],
    pub(super) cluster_of_node: &'a [u32],
    pub(super) edges: &'a [AtomicU64],
    pub(super) round: u32,
    pub(super) clusters: &'a Clusters,
    pub(super) ties: Ties,
}

/// What nodes that grew tell their neighbours.
#[derive(Debug, Default)]
pub(super) struct Look {
    /// Neighbours whose best dual edge led to somebody who merged, each once in all looks of a round; in which of them depends on who
    /// came first.
    pub(super) lost: Vec<u32>,
    /// Edges of other neighbours to nodes that grew, where they may be better than the best.
    pub(super) offers: Vec<(u32, Edge)>,
}

impl Context<'_> {
    /// The packed cost of merging two nodes.
    pub(super) fn price(&self, node: u32, other: u32) -> u32 {
        let [cluster, other] = [node, other].map(|node| self.cluster_of_node[node as usize]);
        dual_edges::price(self.clusters, cluster, other)
    }

    /// Whether one edge of a node is better than another.
    pub(super) fn prefers(&self, node: u32, edge: Edge, than: Edge) -> bool {
        if edge.about > than.about * MARGIN || than.about > edge.about * MARGIN {
            return edge.about < than.about;
        }
        let cluster = |node: u32| self.cluster_of_node[node as usize];
        let rank = |other: u32| Rank::new(self.price(node, other), cluster(node), cluster(other), self.ties);
        rank(edge.other) < rank(than.other)
    }

    fn about(&self, node: u32, other: u32) -> f32 {
        self.nodes[node as usize].end.cost_about(self.nodes[other as usize].end)
    }

    /// Asks for the nodes that some edges lead to.
    fn prefetch_ends(&self, edges: Range<usize>) {
        for edge in &self.edges[edges] {
            prefetch(self.nodes, Edge::unpacked(edge.load(Relaxed)).other as usize);
        }
    }

    /// Lets nodes that grew look among the neighbours of both that they were.
    pub(super) fn look_of_grown(&self, grown: &[Grown]) -> Look {
        let Self { nodes, edges, round, .. } = *self;
        let mut look = Look::default();
        let mut seen = Seen::default();
        for (&Grown { node, ref rows }, ahead) in with_lookahead(grown) {
            if let Some(later) = ahead.stage(2) {
                later.rows.iter().for_each(|row| prefetch(edges, row.start));
            }
            if let Some(later) = ahead.stage(1) {
                later.rows.iter().for_each(|row| self.prefetch_ends(row.clone()));
            }
            let target = &edges[self.rows[node as usize].start..];
            let mut kept = 0;
            let mut cheapest = Cheapest::default();
            seen.begin(rows[0].len() + rows[1].len());
            for edge in rows.iter().flat_map(|row| &edges[row.clone()]) {
                let other = living(nodes, Edge::unpacked(edge.load(Relaxed)).other);
                if other == node || !seen.is_new(other) {
                    continue;
                }
                let about = self.about(node, other);
                target[kept].store(cheapest.add(Edge { other, about }), Relaxed);
                kept += 1;
                let its = nodes[other as usize].best();
                if nodes[other as usize].fate.grown != round && its != Edge::LOST {
                    if !nodes[its.other as usize].fate.is_as_in(its.other, round - 1) {
                        // whoever comes to it finds the same, and the first one says so
                        if nodes[other as usize].lose_best() {
                            look.lost.push(other);
                        }
                    } else if about <= its.about * MARGIN {
                        look.offers.push((other, Edge { other: node, about }));
                    }
                }
            }
            self.has_found(node, &target[..kept], cheapest);
        }
        look
    }

    /// Lets nodes look that did not grow.
    pub(super) fn look_of_lost(&self, lost: &[u32]) {
        let Self { nodes, rows, edges, .. } = *self;
        let mut seen = Seen::default();
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
            let mut cheapest = Cheapest::default();
            seen.begin(edges.len());
            for at in 0..edges.len() {
                let mut edge = Edge::unpacked(edges[at].load(Relaxed));
                // two that were as they are cannot be one
                if !nodes[edge.other as usize].fate.is_as_in(edge.other, row.looked()) {
                    let other = living(nodes, edge.other);
                    if !seen.is_new(other) {
                        continue;
                    }
                    edge = Edge { other, about: self.about(node, other) };
                }
                edges[kept].store(cheapest.add(edge), Relaxed);
                kept += 1;
            }
            self.has_found(node, &edges[..kept], cheapest);
        }
    }

    /// A node that looked has these edges now; keeps how many, and the best of them.
    fn has_found(&self, node: u32, edges: &[AtomicU64], cheapest: Cheapest) {
        let mut best = Edge::unpacked(cheapest.first);
        if Edge::unpacked(cheapest.second).about <= best.about * MARGIN {
            for edge in edges.iter().map(|edge| Edge::unpacked(edge.load(Relaxed))) {
                if edge.other != best.other && self.prefers(node, edge, best) {
                    best = edge;
                }
            }
        }
        self.nodes[node as usize].set_best(best);
        self.rows[node as usize].renew(edges.len(), self.round);
    }
}

/// The two cheapest edges of a row to single precision, packed.
#[derive(Debug, Clone, Copy)]
struct Cheapest {
    first: u64,
    second: u64,
}

impl Default for Cheapest {
    fn default() -> Self {
        Self { first: Edge::NONE.packed(), second: Edge::NONE.packed() }
    }
}

impl Cheapest {
    /// Looks at an edge, and returns it packed.
    fn add(&mut self, edge: Edge) -> u64 {
        let packed = edge.packed();
        self.second = self.second.min(packed.max(self.first));
        self.first = self.first.min(packed);
        packed
    }
}

/// The nodes that a look has come to, in a table of which half is empty at least.
#[derive(Debug, Default)]
struct Seen {
    slots: Vec<u32>,
    shift: u32,
}

impl Seen {
    /// Forgets all, and makes room for so many.
    fn begin(&mut self, at_most: usize) {
        let slots = (2 * at_most).next_power_of_two().max(16);
        self.shift = 32 - slots.trailing_zeros();
        self.slots.clear();
        self.slots.resize(slots, NOBODY);
    }

    /// Whether it comes to a node for the first time.
    fn is_new(&mut self, node: u32) -> bool {
        // multiples of the golden ratio spread evenly (Knuth, TAOCP 6.4)
        let mut at = (node.wrapping_mul(0x9e37_79b9) >> self.shift) as usize;
        loop {
            match self.slots[at] {
                NOBODY => {
                    self.slots[at] = node;
                    return true;
                }
                there if there == node => return false,
                _ => at = (at + 1) % self.slots.len(),
            }
        }
    }
}
