//! The graph of clusters, contracted as they merge.
//!
//! It replaces the faces as long as none of them moves: in hierarchies without optimisation, and in others before the
//! first round that is optimised. A round costs in proportion to the clusters that merge and to their neighbours, not
//! to the number of clusters or to the length of their boundaries. A list of all choices goes over the faces.
//!
//! # Which nodes search again
//!
//! After a round only two kinds of nodes search for their best edge: nodes that grew, and nodes whose best edge led to
//! a node that merged. Any other node keeps its best edge, because the costs of its other edges have not changed,
//! unless a grown neighbour offers a better one: a grown node computes the costs of all its edges anyway. The row of a
//! node is not updated until the node searches; it may name nodes that have ended, which are then resolved.
//!
//! # Which edges have packed costs
//!
//! Rows have [rough costs](Functional::rough_merge_cost). Only edges whose costs are closer than their margin, and the
//! resulting pairs, get packed costs.

mod node;
mod search;

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use self::node::{Edge, Grown, NO_NODE, Node, NodeEdges, Status, resolve};
use self::search::SearchResult;
use crate::device::cpu::best_edge::{self, rough_end};
use crate::device::cpu::clusters::Clusters;
use crate::device::cpu::tuning::chunks::ITEMS;
use crate::device::dual_edge::{Rank, Ties};
use crate::energy::{End, Functional};
use crate::parallel;
use crate::surface::DualGraph;

/// The round before the first. A row of this round has no costs.
const NEVER: u32 = 0;

/// The living clusters, their neighbours and their best dual edges.
///
/// A node stands for the cluster of its number.
#[derive(Debug)]
pub struct Contraction<E: Functional> {
    nodes: Vec<Node<E>>,
    rows: Vec<NodeEdges>,
    /// The rows of the nodes, and edges that are no longer in a row. One thread at a time writes a row.
    edges: Vec<AtomicU64>,
    /// The nodes that grew in the last round.
    grown: Vec<Grown>,
    /// The pairs of nodes whose best edges lead to each other.
    pairs: Vec<Rank<u32>>,
    /// Number of the round, from 1.
    round: u32,
    /// Number of edges after the last compaction.
    compacted: usize,
    /// Which of equally cheap dual edges is the best.
    pub ties: Ties,
    /// Whether the best edges are those after the last round.
    pub is_current: bool,
}

impl<E: Functional> Contraction<E> {
    /// The graph of clusters that are one face each.
    pub fn new(graph: &DualGraph<E>, ties: Ties) -> Self {
        let faces = graph.faces() as u32;
        let row = |face: u32| {
            let start = graph.neighbours.offsets[face as usize] as usize;
            NodeEdges::new(start, graph.neighbours_of(face).len() as u32, NEVER)
        };
        let node = |face: u32| Node {
            end: End { weight: 0.0, proxy: E::NO_PROXY },
            status: Status { into: face, grown: NEVER + 1 },
            best: Edge::LOST.packed().into(),
        };
        let edge = |&other: &u32| AtomicU64::new(Edge { other, cost: 0.0 }.packed());
        let mut edges = Vec::with_capacity(room(graph.neighbours.items.len(), graph.faces()));
        edges.extend(graph.neighbours.items.iter().map(edge));
        Self {
            rows: (0..faces).map(row).collect(),
            nodes: (0..faces).map(node).collect(),
            compacted: edges.len(),
            edges,
            grown: Vec::new(),
            pairs: Vec::new(),
            round: NEVER,
            ties,
            is_current: false,
        }
    }

    /// The neighbour that each cluster would best merge with, in the order of the clusters.
    pub fn choices(&mut self, clusters: &Clusters<E>) -> Vec<(u32, u32)> {
        self.update(clusters);
        let choice = |node: usize| {
            let other = self.nodes[node].best().other;
            (other != NO_NODE).then_some((node as u32, other))
        };
        parallel::list(self.nodes.len(), ITEMS, &|range, choices| choices.extend(range.filter_map(choice)))
    }

    /// The pairs of clusters that chose each other, in any order. They are kept between rounds: only new ones get
    /// packed costs.
    pub fn mutual(&mut self, clusters: &Clusters<E>) -> Vec<Rank<u32>> {
        self.update(clusters);
        self.pairs.clone()
    }

    /// Merges the first cluster of each pair into the second; no cluster is in two pairs. The best edges are current.
    pub fn merge(&mut self, pairs: &[(u32, u32)]) {
        debug_assert!(self.is_current);
        if self.edges.len() > room(self.compacted, self.rows.len()) {
            self.compact();
        }
        self.round += 1;
        let mut end = self.edges.len();
        for &(from, into) in pairs {
            let rows = [into, from].map(|node| self.rows[node as usize].edges());
            let ended = &mut self.nodes[from as usize];
            ended.status.into = into;
            ended.set_best(Edge::NONE);
            self.nodes[into as usize].status.grown = self.round;
            self.rows[into as usize] = NodeEdges::new(end, 0, self.round);
            end += rows[0].len() + rows[1].len();
            self.grown.push(Grown { node: into, rows });
        }
        self.edges.resize_with(end, AtomicU64::default);
        self.is_current = false;
    }

    /// Finds the best edges after the last round, and the pairs.
    fn update(&mut self, clusters: &Clusters<E>) {
        if self.is_current {
            return;
        }
        self.is_current = true;
        let grown = std::mem::take(&mut self.grown);
        let end = |cluster: u32| rough_end(clusters, cluster);
        let mut lost = Vec::new();
        if self.round == NEVER {
            self.round += 1;
            (0..).zip(&mut self.nodes).for_each(|(cluster, node)| node.end = end(cluster));
            lost = (0..self.rows.len() as u32).collect();
        }
        for grown in &grown {
            self.nodes[grown.node as usize].end = end(grown.node);
        }
        let search = |range| self.search_grown(clusters, &grown[range]);
        let results: Vec<SearchResult> = parallel::ranges(grown.len(), ITEMS, &search);
        for &(node, edge) in results.iter().flat_map(|result| &result.offers) {
            // nodes that search by themselves get no offers
            if self.prefers(clusters, node, edge, self.nodes[node as usize].best()) {
                self.nodes[node as usize].set_best(edge);
            }
        }
        lost.extend(results.into_iter().flat_map(|result| result.lost));
        parallel::ranges(lost.len(), ITEMS, &|range| self.search_lost(clusters, &lost[range]));
        let searched: Vec<u32> = grown.iter().map(|grown| grown.node).chain(lost).collect();
        self.pair_up(clusters, &searched);
    }

    /// Finds the pairs whose best edges lead to each other, given the nodes that searched in this round. A new pair has
    /// such a node, because offers lead to grown nodes.
    fn pair_up(&mut self, clusters: &Clusters<E>, searched: &[u32]) {
        let choice = |node: u32| self.nodes[node as usize].best().other;
        // a node that searched without having grown did so because its choice had grown or ended, or in the first round
        let has_grown = |node: u32| self.nodes[node as usize].status.grown == self.round;
        let stays = |pair: &Rank<u32>| {
            let (a, b) = pair.ends();
            choice(a) == b && choice(b) == a && !has_grown(a) && !has_grown(b)
        };
        let has_searched = |node: u32| self.rows[node as usize].searched() == self.round;
        let pair = |&node: &u32| {
            let other = choice(node);
            let is_new = other != NO_NODE && choice(other) == node && (node < other || !has_searched(other));
            is_new.then(|| Rank::new(best_edge::packed_cost(clusters, node, other), node, other, Ties::Hash))
        };
        let kept = &self.pairs;
        let mut pairs = parallel::list(kept.len(), ITEMS, &|range, pairs| {
            pairs.extend(kept[range].iter().copied().filter(stays));
        });
        pairs.append(&mut parallel::list(searched.len(), ITEMS, &|range, pairs| {
            pairs.extend(searched[range].iter().filter_map(pair));
        }));
        self.pairs = pairs;
    }

    /// Drops the edges that are in no row of a living node. The rows of others are not read any more.
    fn compact(&mut self) {
        let Self { nodes, rows, edges, .. } = self;
        let is_living = |node: u32| nodes[node as usize].status.into == node;
        let living =
            (0..).zip(rows.iter()).filter(|&(node, _)| is_living(node)).map(|(_, row)| row.edges().len()).sum();
        let mut kept = Vec::with_capacity(room(living, rows.len()));
        for (_, row) in (0..).zip(rows).filter(|&(node, _)| is_living(node)) {
            let of_row = row.edges();
            row.start = kept.len();
            kept.extend(edges[of_row].iter().map(|edge| AtomicU64::new(edge.load(Relaxed))));
        }
        self.compacted = kept.len();
        self.edges = kept;
    }
}

/// Number of edges at which they are compacted.
fn room(compacted: usize, nodes: usize) -> usize {
    2 * compacted + nodes
}

#[cfg(test)]
mod tests;
