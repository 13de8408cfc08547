//! The graph of clusters, contracted as they merge: who lies beside whom, and what merging with them costs.
//!
//! It stands for the faces as long as none of them moves: in hierarchies without optimisation, and in the others before the first
//! round that is optimised. A round then costs in proportion to the clusters that merge and to those beside them, however many others there
//! are and however long their borders.
//!
//! # Who looks for its best dual edge again
//!
//! Only a cluster that grew, and one whose best dual edge led to one that merged. Any other keeps its best, unless a grown
//! neighbour offers a better one: the costs of the others beside it are what they were. The grown neighbour knows what
//! merging would cost, because it looks at all of its own neighbours anyway. So the row of a cluster is left as it is until
//! it has to look again: it then may name nodes that ended long ago, and those are followed to what they became part of.
//!
//! # Which dual edges are priced
//!
//! Rows keep costs in single precision ([`RoughEnd::cost_about`]), off by 2⁻²⁰ of them at most. An edge that by those costs
//! more than [`MARGIN`] times as much as another costs more by packed costs too, which tell 1 + 2⁻²⁴ apart: it is not the
//! best. Only edges that are nearer to each other than that are compared by their packed costs and the tie rule, and pairs
//! that chose each other are priced.

mod look;

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use self::look::{Context, Look};
use super::clusters::Clusters;
use crate::cluster::dual_edge::{Rank, Ties};
use crate::device::DualEdge;
use crate::surface::DualGraph;

/// Nodes a thread takes at a time.
const CHUNK: usize = 1024;

/// In place of a node: none.
const NOBODY: u32 = u32::MAX;

/// Before the first round: no node grew then, so whoever looked then knows no cost.
const NEVER: u32 = 0;

/// Costs in single precision that differ by more than this factor are in the order of the packed costs: their errors of
/// 2⁻²⁰ leave more than 2⁻¹⁹ of it.
const MARGIN: f32 = 1.0 + 1.0 / (1 << 18) as f32;

/// The living clusters, their neighbours and their best dual edges.
///
/// Here a cluster goes by the number of its node. Nodes are in the order of their clusters, and numbered anew when half of
/// them have ended, so that those that are left lie close together.
#[derive(Debug)]
pub struct Contraction {
    nodes: Vec<Node>,
    rows: Vec<Row>,
    cluster_of_node: Vec<u32>,
    /// The node of each cluster that has not ended.
    node_of_cluster: Vec<u32>,
    /// Rows of neighbours, and what no node needs any more. Each row is written by one thread at a time.
    edges: Vec<AtomicU64>,
    /// The nodes that grew by the last merges.
    grown: Vec<Grown>,
    /// The pairs of nodes that chose each other, ranked as clusters.
    pairs: Vec<(Rank<u32>, [u32; 2])>,
    /// Counts the merges of many pairs at once, from 1.
    round: u32,
    /// Nodes that have ended.
    ended: usize,
    /// Edges when those were last let go that nobody needs.
    settled: usize,
    /// Which of equally cheap dual edges is the best.
    ties: Ties,
    /// Whether the best dual edges are those after the last merges.
    is_current: bool,
}

/// What others ask about a node: all of it lies together, because they come in no order.
#[derive(Debug)]
#[repr(align(32))]
struct Node {
    end: RoughEnd,
    fate: Fate,
    /// Its best edge, packed. Who looks writes its own; a neighbour that grew may say before that it is [lost](Edge::LOST), and offers
    /// are taken in between.
    best: AtomicU64,
}

/// The neighbours of a node: those that it had when it last looked. Who looks writes its own.
#[derive(Debug)]
struct Row {
    /// Its first edge.
    start: usize,
    /// Its edges.
    len: AtomicU32,
    /// The round in which the node last looked; [`NEVER`] when each cost must be found anew.
    looked: AtomicU32,
}

/// What became of a node.
#[derive(Debug, Clone, Copy)]
struct Fate {
    /// The node that it became part of; itself while it lives.
    into: u32,
    /// The round in which it last grew.
    grown: u32,
}

/// A node that grew.
#[derive(Debug)]
struct Grown {
    node: u32,
    /// The edges of the two that it was.
    rows: [Range<usize>; 2],
}

/// The node of a neighbour, or [`NOBODY`], and the cost of merging with it in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
    other: u32,
    about: f32,
}

/// A cluster as an end of a dual edge, to single precision.
#[derive(Debug, Clone, Copy)]
struct RoughEnd {
    weight: f32,
    proxy: [i32; 3],
}

impl Contraction {
    /// Of clusters that are a face each.
    pub fn new(graph: &DualGraph, ties: Ties) -> Self {
        let faces = graph.faces() as u32;
        let row = |face: u32| {
            let start = graph.neighbour_offsets[face as usize] as usize;
            Row::new(start, graph.neighbours_of(face).len() as u32, NEVER)
        };
        let node = |face: u32| Node {
            end: RoughEnd { weight: 0.0, proxy: [0; 3] },
            fate: Fate { into: face, grown: NEVER + 1 },
            best: Edge::LOST.packed().into(),
        };
        let edge = |&other: &u32| AtomicU64::new(Edge { other, about: 0.0 }.packed());
        let mut edges = Vec::with_capacity(room(graph.neighbours.len(), graph.faces()));
        edges.extend(graph.neighbours.iter().map(edge));
        Self {
            rows: (0..faces).map(row).collect(),
            nodes: (0..faces).map(node).collect(),
            cluster_of_node: (0..faces).collect(),
            node_of_cluster: (0..faces).collect(),
            settled: edges.len(),
            edges,
            grown: Vec::new(),
            pairs: Vec::new(),
            round: NEVER,
            ended: 0,
            ties,
            is_current: false,
        }
    }

    /// Which of equally cheap dual edges is the best.
    pub fn ties(&self) -> Ties {
        self.ties
    }

    /// The best dual edge of each cluster that has neighbours, in the order of the clusters.
    pub fn best(&mut self, clusters: &Clusters) -> Vec<DualEdge> {
        self.update(clusters);
        let context = self.context(clusters);
        let edge = |(number, node): (usize, &Node)| {
            let other = node.best().other;
            (other != NOBODY).then(|| DualEdge {
                cluster: context.cluster_of_node[number],
                other: context.cluster_of_node[other as usize],
                cost: context.price(number as u32, other),
            })
        };
        self.nodes.par_iter().enumerate().with_min_len(CHUNK).filter_map(edge).collect()
    }

    /// The pairs of clusters that chose each other, in no particular order: another one each time.
    pub fn mutual(&mut self, clusters: &Clusters) -> Vec<Rank<u32>> {
        self.update(clusters);
        self.pairs.iter().map(|(rank, _)| *rank).collect()
    }

    /// Lets clusters become part of others, each the first of its pair of the second; no cluster is in two pairs. `clusters`
    /// do not know of it yet.
    pub fn merge(&mut self, clusters: &Clusters, pairs: &[(u32, u32)]) {
        self.update(clusters);
        // the second where a cluster with a long row grows little by little
        if self.ended > self.rows.len() / 2 || self.edges.len() > room(self.settled, self.rows.len()) {
            self.compact();
        }
        self.round += 1;
        let mut end = self.edges.len();
        for &(from, into) in pairs {
            let [into, from] = [into, from].map(|cluster| self.node_of_cluster[cluster as usize]);
            let rows = [into, from].map(|node| self.rows[node as usize].edges());
            let ended = &mut self.nodes[from as usize];
            ended.fate.into = into;
            ended.set_best(Edge::NONE);
            self.nodes[into as usize].fate.grown = self.round;
            self.rows[into as usize] = Row::new(end, 0, self.round);
            end += rows[0].len() + rows[1].len();
            self.grown.push(Grown { node: into, rows });
        }
        self.edges.resize_with(end, AtomicU64::default);
        self.ended += pairs.len();
        self.is_current = false;
    }

    /// Finds the best dual edges after the last merges, and the pairs that chose each other.
    fn update(&mut self, clusters: &Clusters) {
        if self.is_current {
            return;
        }
        self.is_current = true;
        let grown = std::mem::take(&mut self.grown);
        let end =
            |cluster: u32| RoughEnd { weight: clusters.sums(cluster).weight as f32, proxy: clusters.proxy(cluster) };
        let mut lost = Vec::new();
        if self.round == NEVER {
            self.round += 1;
            self.nodes.iter_mut().zip(&self.cluster_of_node).for_each(|(node, &cluster)| node.end = end(cluster));
            lost = (0..self.rows.len() as u32).collect();
        }
        for grown in &grown {
            self.nodes[grown.node as usize].end = end(self.cluster_of_node[grown.node as usize]);
        }
        let context = self.context(clusters);
        let looks: Vec<Look> = grown.par_chunks(CHUNK).map(|grown| context.look_of_grown(grown)).collect();
        for &(node, edge) in looks.iter().flat_map(|look| &look.offers) {
            // nobody offers anything to a node that has to look anyway
            if context.prefers(node, edge, self.nodes[node as usize].best()) {
                self.nodes[node as usize].set_best(edge);
            }
        }
        lost.extend(looks.into_iter().flat_map(|look| look.lost));
        lost.par_chunks(CHUNK).for_each(|lost| context.look_of_lost(lost));
        let looked: Vec<u32> = grown.iter().map(|grown| grown.node).chain(lost).collect();
        self.pair_up(clusters, &looked);
    }

    /// Finds the pairs that chose each other, given the nodes that looked in this round.
    ///
    /// A new pair has such a node: one that took an offer chose a grown one.
    fn pair_up(&mut self, clusters: &Clusters, looked: &[u32]) {
        let context = self.context(clusters);
        let choice = |node: u32| self.nodes[node as usize].best().other;
        // who looked without having grown did so because its choice had grown or ended, or because nobody had looked before
        let has_grown = |node: u32| self.nodes[node as usize].fate.grown == self.round;
        let stays = |&(_, [a, b]): &(_, [u32; 2])| choice(a) == b && choice(b) == a && !has_grown(a) && !has_grown(b);
        let has_looked = |node: u32| self.rows[node as usize].looked() == self.round;
        let pair = |&node: &u32| {
            let other = choice(node);
            let is_new = other != NOBODY && choice(other) == node && (node < other || !has_looked(other));
            is_new.then(|| {
                let [low, high] = [node, other].map(|node| self.cluster_of_node[node as usize]);
                (Rank::new(context.price(node, other), low, high, Ties::Hash), [node, other])
            })
        };
        let mut pairs: Vec<_> = self.pairs.par_iter().with_min_len(CHUNK).copied().filter(stays).collect();
        pairs.par_extend(looked.par_iter().with_min_len(CHUNK).filter_map(pair));
        self.pairs = pairs;
    }

    /// Lets go of nodes that have ended, and of edges that nobody needs. The best dual edges are current.
    fn compact(&mut self) {
        let Self { nodes, rows, edges, .. } = self;
        let mut new_number = vec![NOBODY; rows.len()];
        let mut left = Vec::with_capacity(rows.len() - self.ended);
        let mut end = 0;
        for (number, row) in rows.iter().enumerate().filter(|&(number, _)| nodes[number].fate.into == number as u32) {
            let new = left.len();
            new_number[number] = new as u32;
            self.node_of_cluster[self.cluster_of_node[number] as usize] = new as u32;
            self.cluster_of_node[new] = self.cluster_of_node[number];
            left.push((number as u32, row, end));
            end += row.edges().len();
        }
        self.cluster_of_node.truncate(left.len());
        self.pairs.iter_mut().flat_map(|(_, nodes)| nodes).for_each(|node| *node = new_number[*node as usize]);

        let mut settled = Vec::with_capacity(room(end, left.len()));
        settled.resize_with(end, AtomicU64::default);
        let settle = |&(_, row, start): &(u32, &Row, usize)| {
            let row_edges = &edges[row.edges()];
            let mut looked = row.looked();
            for (target, edge) in settled[start..].iter().zip(row_edges) {
                let Edge { other, about } = Edge::unpacked(edge.load(Relaxed));
                if !nodes[other as usize].fate.is_as_in(other, row.looked()) {
                    looked = NEVER;
                }
                let other = new_number[living(nodes, other) as usize];
                target.store(Edge { other, about }.packed(), Relaxed);
            }
            Row::new(start, row_edges.len() as u32, looked)
        };
        let new_rows = left.par_iter().with_min_len(CHUNK).map(settle).collect();
        let renewed = |(new, &(old, ..)): (u32, &(u32, &Row, usize))| {
            let Node { end, fate, best } = &nodes[old as usize];
            let mut best = Edge::unpacked(best.load(Relaxed));
            if best.other != NOBODY {
                best.other = new_number[best.other as usize];
            }
            Node { end: *end, fate: Fate { into: new, ..*fate }, best: best.packed().into() }
        };
        self.nodes = (0..).zip(&left).map(renewed).collect();
        self.rows = new_rows;
        self.ended = 0;
        self.settled = end;
        self.edges = settled;
    }

    fn context<'a>(&'a self, clusters: &'a Clusters) -> Context<'a> {
        Context {
            nodes: &self.nodes,
            rows: &self.rows,
            cluster_of_node: &self.cluster_of_node,
            edges: &self.edges,
            round: self.round,
            clusters,
            ties: self.ties,
        }
    }
}

/// Edges that there may be before those are let go that nobody needs, where so many were needed last.
fn room(settled: usize, nodes: usize) -> usize {
    2 * settled + nodes
}

/// What a node became part of; itself while it lives.
fn living(nodes: &[Node], mut node: u32) -> u32 {
    loop {
        let into = nodes[node as usize].fate.into;
        if into == node {
            return node;
        }
        node = into;
    }
}

impl Node {
    fn best(&self) -> Edge {
        Edge::unpacked(self.best.load(Relaxed))
    }

    fn set_best(&self, edge: Edge) {
        self.best.store(edge.packed(), Relaxed);
    }

    /// Says that it has lost its best edge, and whether that is news.
    fn lose_best(&self) -> bool {
        self.best.swap(Edge::LOST.packed(), Relaxed) != Edge::LOST.packed()
    }
}

impl Row {
    fn new(start: usize, len: u32, looked: u32) -> Self {
        Self { start, len: len.into(), looked: looked.into() }
    }

    fn edges(&self) -> Range<usize> {
        self.start..self.start + self.len.load(Relaxed) as usize
    }

    fn looked(&self) -> u32 {
        self.looked.load(Relaxed)
    }

    /// Has so many edges now, of a round.
    fn renew(&self, len: usize, round: u32) {
        self.len.store(len as u32, Relaxed);
        self.looked.store(round, Relaxed);
    }
}

impl Fate {
    /// Whether the node of this fate is what it was at the end of a round.
    fn is_as_in(self, node: u32, round: u32) -> bool {
        self.into == node && self.grown <= round
    }
}

impl RoughEnd {
    /// M₁M₂·|P₁−P₂|²/(M₁+M₂) in units of the clusters' component, off by 12·2⁻²⁴ of it at most: each conversion and each
    /// operation adds 2⁻²⁴ to what the errors of both sides add up to, and nothing is subtracted but integers.
    fn cost_about(self, other: Self) -> f32 {
        let square = |axis: usize| {
            let difference = (self.proxy[axis] - other.proxy[axis]) as f32;
            difference * difference
        };
        let harmonic = self.weight * other.weight / (self.weight + other.weight);
        harmonic * (square(0) + square(1) + square(2))
    }
}

impl Edge {
    const NONE: Self = Self { other: NOBODY, about: f32::INFINITY };

    /// In place of the best edge of a node that has to look for it.
    const LOST: Self = Self { other: NOBODY, about: -1.0 };

    /// In the order of the costs, which are not negative.
    fn packed(self) -> u64 {
        u64::from(self.about.to_bits()) << 32 | u64::from(self.other)
    }

    fn unpacked(packed: u64) -> Self {
        Self { other: packed as u32, about: f32::from_bits((packed >> 32) as u32) }
    }
}

#[cfg(test)]
mod tests;
