//! The graph of clusters, contracted as they merge.
//!
//! It replaces the faces as long as none of them moves: in hierarchies without optimisation, and in others before the
//! first round that is optimised. The searches of a round cost in proportion to the clusters that merge and to their
//! neighbours, not to the number of clusters or to the length of their boundaries.
//!
//! After a round only two kinds of nodes search for their best edge: nodes that grew, and nodes whose best edge led to
//! a node that merged. Any other node keeps its best edge, because the costs of its other edges have not changed,
//! unless a grown neighbour offers a better one: a grown node computes the costs of all its edges anyway. The row of a
//! node is not updated until the node searches; it may name nodes that have ended, which are then resolved.

mod node;
mod search;

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use self::node::{Edge, Grown, NO_NODE, Node, Row};
use self::search::{Context, SearchResult};
use crate::device::cpu::clusters::Clusters;
use crate::device::cpu::tuning::chunks::ITEMS;
use crate::device::dual_edge::Ties;
use crate::surface::DualGraph;

/// The round before the first. A row of this round has no costs.
const NEVER: u32 = 0;

/// The clusters, their neighbours and their best dual edges. A node stands for the cluster of the same number.
#[derive(Debug)]
pub struct Contraction {
    nodes: Vec<Node>,
    rows: Vec<Row>,
    /// The rows of the nodes, and edges that are no longer in a row. One thread at a time writes a row.
    edges: Vec<AtomicU64>,
    /// The nodes that grew in the last round.
    grown: Vec<Grown>,
    /// Number of the round, from 1.
    round: u32,
    /// Number of edges after the last compaction.
    compacted: usize,
    /// Which of equally cheap dual edges is the best.
    ties: Ties,
    /// Whether the best edges are those after the last round.
    is_current: bool,
}

impl Contraction {
    /// The graph of clusters that are one face each.
    pub fn new(graph: &DualGraph, ties: Ties) -> Self {
        let row = |face: u32| {
            let start = graph.neighbour_offsets[face as usize] as usize;
            Row::new(start, graph.neighbours_of(face).len() as u32, NEVER)
        };
        let faces = 0..graph.faces() as u32;
        let mut edges = Vec::with_capacity(room(graph.neighbours.len(), graph.faces()));
        edges.extend(graph.neighbours.iter().map(|&other| AtomicU64::new(Edge { other, cost: 0 }.packed())));
        Self {
            nodes: faces.clone().map(|face| Node::new(face, NEVER + 1)).collect(),
            rows: faces.map(row).collect(),
            compacted: edges.len(),
            edges,
            grown: Vec::new(),
            round: NEVER,
            ties,
            is_current: false,
        }
    }

    /// Which of equally cheap dual edges is the best.
    pub fn ties(&self) -> Ties {
        self.ties
    }

    /// The neighbour that each cluster would best merge with, in the order of the clusters.
    pub fn choices(&mut self, clusters: &Clusters) -> Vec<(u32, u32)> {
        self.update(clusters);
        let choice = |(cluster, node): (usize, &Node)| {
            let other = node.best().other;
            (other != NO_NODE).then_some((cluster as u32, other))
        };
        self.nodes.par_iter().enumerate().with_min_len(ITEMS).filter_map(choice).collect()
    }

    /// Merges the first cluster of each pair into the second; no cluster is in two pairs. Call it before `clusters` are
    /// merged.
    pub fn merge(&mut self, clusters: &Clusters, pairs: &[(u32, u32)]) {
        self.update(clusters);
        if self.edges.len() > room(self.compacted, self.rows.len()) {
            self.compact();
        }
        self.round += 1;
        let mut end = self.edges.len();
        for &(from, into) in pairs {
            let rows = [into, from].map(|node| self.rows[node as usize].edges());
            let ended = &mut self.nodes[from as usize];
            ended.into = into;
            ended.set_best(Edge::NONE);
            self.nodes[into as usize].grown = self.round;
            self.rows[into as usize] = Row::new(end, 0, self.round);
            self.rows[from as usize] = Row::new(end, 0, self.round);
            end += rows[0].len() + rows[1].len();
            self.grown.push(Grown { node: into, rows });
        }
        self.edges.resize_with(end, AtomicU64::default);
        self.is_current = false;
    }

    /// Finds the best edges after the last round.
    fn update(&mut self, clusters: &Clusters) {
        if std::mem::replace(&mut self.is_current, true) {
            return;
        }
        let grown = std::mem::take(&mut self.grown);
        let mut lost = Vec::new();
        if self.round == NEVER {
            self.round += 1;
            lost = (0..self.rows.len() as u32).collect();
        }
        let Self { nodes, rows, edges, round, ties, .. } = self;
        let context = Context { nodes, rows, edges, round: *round, clusters, ties: *ties };
        let results: Vec<SearchResult> = grown.par_chunks(ITEMS).map(|grown| context.search_grown(grown)).collect();
        for &(node, edge) in results.iter().flat_map(|result| &result.offers) {
            let best = nodes[node as usize].best();
            // nodes that search by themselves get no offers
            if best != Edge::LOST && context.prefers(node, edge, best) {
                nodes[node as usize].set_best(edge);
            }
        }
        lost.extend(results.into_iter().flat_map(|result| result.lost));
        lost.par_chunks(ITEMS).for_each(|lost| context.search_lost(lost));
    }

    /// Drops edges that are in no row. The best edges are current.
    fn compact(&mut self) {
        let edges = std::mem::take(&mut self.edges);
        let left: usize = self.rows.iter().map(|row| row.edges().len()).sum();
        self.edges.reserve_exact(room(left, self.rows.len()));
        for row in &mut self.rows {
            let kept = row.edges();
            row.start = self.edges.len();
            self.edges.extend(edges[kept].iter().map(|edge| AtomicU64::new(edge.load(Relaxed))));
        }
        self.compacted = left;
    }
}

/// Number of edges at which they are compacted.
fn room(compacted: usize, nodes: usize) -> usize {
    2 * compacted + nodes
}

#[cfg(test)]
mod tests;
