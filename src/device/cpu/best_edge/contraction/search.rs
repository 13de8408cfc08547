//! How a node of the contraction searches for its best edge.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::{Edge, Grown, Node, Row};
use crate::device::cpu::best_edge::packed_cost;
use crate::device::cpu::clusters::Clusters;
use crate::device::dual_edge::{Rank, Ties};
use crate::prefetch::{prefetch, with_lookahead};

/// What a search reads. It writes the row and the best edge of the searching node. Several threads search at a time;
/// their results do not depend on the order, because nodes do not merge meanwhile, and a search reads the best edges
/// only of nodes that do not search.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub(super) nodes: &'a [Node],
    pub(super) rows: &'a [Row],
    pub(super) edges: &'a [AtomicU64],
    pub(super) round: u32,
    pub(super) clusters: &'a Clusters,
    pub(super) ties: Ties,
}

/// What the searches of grown nodes find about their neighbours.
#[derive(Debug, Default)]
pub(super) struct SearchResult {
    /// Neighbours whose best edge led to a node that merged: each once in all results of a round, in any of them.
    pub(super) lost: Vec<u32>,
    /// Other neighbours and their edges to grown nodes, where these may be better than their best.
    pub(super) offers: Vec<(u32, Edge)>,
}

impl Context<'_> {
    /// Whether one edge of a node is better than another.
    pub(super) fn prefers(&self, node: u32, edge: Edge, than: Edge) -> bool {
        let tie = |other: u32| Rank::new(edge.cost, node, other, self.ties);
        edge.cost < than.cost || edge.cost == than.cost && tie(edge.other) < tie(than.other)
    }

    /// The edge from one node to another.
    fn edge(&self, node: u32, other: u32) -> Edge {
        Edge { other, cost: packed_cost(self.clusters, node, other) }
    }

    /// The living node that an edge leads to.
    fn other(&self, edge: &AtomicU64) -> u32 {
        let mut node = Edge::unpacked(edge.load(Relaxed)).other;
        while self.nodes[node as usize].into != node {
            node = self.nodes[node as usize].into;
        }
        node
    }

    /// Requests the nodes that some edges lead to.
    fn prefetch_ends(&self, edges: Range<usize>) {
        for edge in &self.edges[edges] {
            prefetch(self.nodes, Edge::unpacked(edge.load(Relaxed)).other as usize);
        }
    }

    /// Nodes that grew search among the neighbours of both nodes that merged.
    pub(super) fn search_grown(&self, grown: &[Grown]) -> SearchResult {
        let Self { nodes, edges, round, .. } = *self;
        let mut result = SearchResult::default();
        let mut others = Vec::new();
        for (&Grown { node, ref rows }, ahead) in with_lookahead(grown) {
            if let Some(later) = ahead.stage(2) {
                later.rows.iter().for_each(|row| prefetch(edges, row.start));
            }
            if let Some(later) = ahead.stage(1) {
                later.rows.iter().for_each(|row| self.prefetch_ends(row.clone()));
            }
            others.clear();
            let old = rows.iter().flat_map(|row| &edges[row.clone()]);
            others.extend(old.map(|edge| self.other(edge)).filter(|&other| other != node));
            others.sort_unstable();
            others.dedup();
            let mut row = NewRow::new(&edges[self.rows[node as usize].start..]);
            for &other in &others {
                let edge = self.edge(node, other);
                row.add(self, node, edge);
                let its = nodes[other as usize].best();
                if nodes[other as usize].grown != round && its != Edge::LOST {
                    if !nodes[its.other as usize].is_unchanged_since(its.other, round - 1) {
                        // several searches may find this; the first one reports it
                        if nodes[other as usize].lose_best() {
                            result.lost.push(other);
                        }
                    } else if edge.cost <= its.cost {
                        result.offers.push((other, Edge { other: node, ..edge }));
                    }
                }
            }
            row.store(self, node);
        }
        result
    }

    /// Nodes that did not grow search in their rows.
    pub(super) fn search_lost(&self, lost: &[u32]) {
        let Self { nodes, rows, edges, .. } = *self;
        let mut changed = Vec::new();
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
            let old = &rows[node as usize];
            let edges = &edges[old.edges()];
            let mut row = NewRow::new(edges);
            changed.clear();
            for packed in edges {
                let edge = Edge::unpacked(packed.load(Relaxed));
                // two unchanged nodes cannot be the same, and no changed node has become part of one
                if nodes[edge.other as usize].is_unchanged_since(edge.other, old.searched()) {
                    row.add(self, node, edge);
                } else {
                    changed.push(self.other(packed));
                }
            }
            changed.sort_unstable();
            changed.dedup();
            changed.iter().for_each(|&other| row.add(self, node, self.edge(node, other)));
            row.store(self, node);
        }
    }
}

/// The row that a search writes, and the best of its edges.
struct NewRow<'a> {
    edges: &'a [AtomicU64],
    len: usize,
    best: Edge,
}

impl<'a> NewRow<'a> {
    /// An empty row in place of some edges.
    fn new(edges: &'a [AtomicU64]) -> Self {
        Self { edges, len: 0, best: Edge::NONE }
    }

    fn add(&mut self, context: &Context<'_>, node: u32, edge: Edge) {
        self.edges[self.len].store(edge.packed(), Relaxed);
        self.len += 1;
        if context.prefers(node, edge, self.best) {
            self.best = edge;
        }
    }

    /// Makes it the row of a node.
    fn store(self, context: &Context<'_>, node: u32) {
        context.nodes[node as usize].set_best(self.best);
        context.rows[node as usize].renew(self.len, context.round);
    }
}
