//! The graph of clusters, contracted as they merge: who lies beside whom, and what merging with them costs.
//!
//! It stands for the faces as long as none of them moves: in hierarchies without optimisation, and in the first round of the
//! others. A round then costs in proportion to the clusters that merge and to those beside them, however many others there
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
//! Rows keep costs in single precision ([`Place::cost_about`]), off by 2⁻²⁰ of them at most. An edge that by those costs
//! more than [`MARGIN`] times as much as another costs more by packed costs too, which tell 1 + 2⁻²⁴ apart: it is not the
//! best. Only edges that are nearer to each other than that are compared by their packed costs and the tie rule, and pairs
//! that chose each other are priced.

mod look;

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use self::look::{Context, Found, Look};
use super::clusters::Clusters;
use crate::cluster::dual_edge::{Rank, Ties};
use crate::device::DualEdge;
use crate::surface::DualGraph;

/// Nodes a thread takes at a time.
const CHUNK: usize = 1024;

/// In place of a node: none.
const NOBODY: u32 = u32::MAX;

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
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
struct Node {
    place: Place,
    fate: Fate,
    best: Edge,
}

/// The neighbours of a node: those that it had when it last looked.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Its first edge.
    start: usize,
    /// Its edges.
    len: u32,
    /// The round in which the node last looked; 0 when each cost must be found anew.
    looked: u32,
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
#[derive(Debug, Clone, Copy)]
struct Grown {
    node: u32,
    /// The rows of the two that it was.
    rows: [Row; 2],
}

/// The node of a neighbour, or [`NOBODY`], and the cost of merging with it in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
    other: u32,
    about: f32,
}

/// A cluster as an end of a dual edge, to single precision.
#[derive(Debug, Clone, Copy)]
struct Place {
    weight: f32,
    proxy: [i32; 3],
}

impl Contraction {
    /// Of clusters that are a face each.
    pub fn new(graph: &DualGraph, ties: Ties) -> Self {
        let faces = graph.faces() as u32;
        let row = |face: u32| Row {
            start: graph.neighbour_offsets[face as usize] as usize,
            len: graph.neighbours_of(face).len() as u32,
            looked: 0,
        };
        let node = |face: u32| Node {
            place: Place { weight: 0.0, proxy: [0; 3] },
            fate: Fate { into: face, grown: 1 },
            best: Edge::LOST,
        };
        let mut edges = Vec::with_capacity(room(graph.neighbours.len(), graph.faces()));
        edges.extend(graph.neighbours.iter().map(|&other| AtomicU64::new(Edge { other, about: 0.0 }.packed())));
        Self {
            rows: (0..faces).map(row).collect(),
            nodes: (0..faces).map(node).collect(),
            cluster_of_node: (0..faces).collect(),
            node_of_cluster: (0..faces).collect(),
            settled: edges.len(),
            edges,
            grown: Vec::new(),
            pairs: Vec::new(),
            round: 0,
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
            let other = node.best.other;
            (other != NOBODY).then(|| DualEdge {
                cluster: context.cluster_of_node[number],
                other: context.cluster_of_node[other as usize],
                cost: context.price(number as u32, other),
            })
        };
        self.nodes.par_iter().enumerate().with_min_len(CHUNK).filter_map(edge).collect()
    }

    /// The pairs of clusters that chose each other, in no particular order.
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
            let rows = [into, from].map(|node| self.rows[node as usize]);
            self.grown.push(Grown { node: into, rows });
            let ended = &mut self.nodes[from as usize];
            (ended.fate.into, ended.best) = (into, Edge::NONE);
            self.nodes[into as usize].fate.grown = self.round;
            self.rows[into as usize] = Row { start: end, len: 0, looked: self.round };
            end += (rows[0].len + rows[1].len) as usize;
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
        let place =
            |cluster: u32| Place { weight: clusters.sums(cluster).weight as f32, proxy: clusters.proxy(cluster) };
        let mut lost = Vec::new();
        if self.round == 0 {
            self.round = 1;
            self.nodes.iter_mut().zip(&self.cluster_of_node).for_each(|(node, &cluster)| node.place = place(cluster));
            lost = (0..self.rows.len() as u32).collect();
        }
        for grown in &grown {
            self.nodes[grown.node as usize].place = place(self.cluster_of_node[grown.node as usize]);
        }
        let context = self.context(clusters);
        let looks: Vec<Look> = grown.par_chunks(CHUNK).map(|grown| context.look_of_grown(grown)).collect();
        for look in &looks {
            self.take(&look.found);
            for &node in &look.lost {
                if std::mem::replace(&mut self.nodes[node as usize].best, Edge::LOST) != Edge::LOST {
                    lost.push(node);
                }
            }
        }
        for &(node, edge) in looks.iter().flat_map(|look| &look.offers) {
            let best = self.nodes[node as usize].best;
            if best != Edge::LOST && self.context(clusters).prefers(node, edge, best) {
                self.nodes[node as usize].best = edge;
            }
        }
        let context = self.context(clusters);
        let found: Vec<Vec<Found>> = lost.par_chunks(CHUNK).map(|lost| context.look_of_lost(lost)).collect();
        found.iter().for_each(|found| self.take(found));
        self.pair_up(clusters, grown.iter().map(|grown| grown.node).chain(lost));
    }

    /// Takes over what nodes have found.
    fn take(&mut self, found: &[Found]) {
        for &Found { node, len, best } in found {
            let row = &mut self.rows[node as usize];
            (row.len, row.looked) = (len, self.round);
            self.nodes[node as usize].best = best;
        }
    }

    /// Finds the pairs that chose each other, given the nodes that looked in this round.
    ///
    /// A new pair has such a node: one that took an offer chose a grown one.
    fn pair_up(&mut self, clusters: &Clusters, looked: impl Iterator<Item = u32>) {
        let mut pairs = std::mem::take(&mut self.pairs);
        let choice = |node: u32| self.nodes[node as usize].best.other;
        // who looked without having grown did so because its choice had
        let has_grown = |node: u32| self.nodes[node as usize].fate.grown == self.round;
        pairs.retain(|&(_, [a, b])| choice(a) == b && choice(b) == a && !has_grown(a) && !has_grown(b));
        let has_looked = |node: u32| self.rows[node as usize].looked == self.round;
        let context = self.context(clusters);
        for node in looked {
            let other = choice(node);
            if other != NOBODY && choice(other) == node && (node < other || !has_looked(other)) {
                let [low, high] = [node, other].map(|node| self.cluster_of_node[node as usize]);
                pairs.push((Rank::new(context.price(node, other), low, high, Ties::Hash), [node, other]));
            }
        }
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
            left.push((number as u32, *row, end));
            end += row.len as usize;
        }
        self.cluster_of_node.truncate(left.len());
        self.pairs.iter_mut().flat_map(|(_, nodes)| nodes).for_each(|node| *node = new_number[*node as usize]);

        let mut settled = Vec::with_capacity(room(end, left.len()));
        settled.resize_with(end, AtomicU64::default);
        let settle = |&(_, row, start): &(u32, Row, usize)| {
            let mut looked = row.looked;
            for (target, edge) in settled[start..].iter().zip(row.of(edges)) {
                let Edge { other, about } = Edge::unpacked(edge.load(Relaxed));
                if !nodes[other as usize].fate.is_as_in(other, row.looked) {
                    looked = 0;
                }
                let other = new_number[living(nodes, other) as usize];
                target.store(Edge { other, about }.packed(), Relaxed);
            }
            Row { start, looked, ..row }
        };
        self.rows = left.par_iter().with_min_len(CHUNK).map(settle).collect();
        let renewed = |(new, &(old, ..)): (u32, &(u32, Row, usize))| {
            let mut node = nodes[old as usize];
            node.fate.into = new;
            if node.best.other != NOBODY {
                node.best.other = new_number[node.best.other as usize];
            }
            node
        };
        self.nodes = (0..).zip(&left).map(renewed).collect();
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

impl Row {
    fn of<'a>(&self, edges: &'a [AtomicU64]) -> &'a [AtomicU64] {
        &edges[self.start..][..self.len as usize]
    }
}

impl Fate {
    /// Whether the node of this fate is what it was at the end of a round.
    fn is_as_in(self, node: u32, round: u32) -> bool {
        self.into == node && self.grown <= round
    }
}

impl Place {
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
mod tests {
    use super::*;
    use crate::cluster::dual_edge::{End, mutual, packed_cost};
    use crate::sample::{Sample, generate};
    use crate::surface::{Component, Surface};

    /// Clusters and their contraction, and what the faces themselves say about them.
    struct Both<'a> {
        graph: &'a DualGraph,
        ties: Ties,
        labels: Vec<u32>,
        clusters: Clusters,
        contraction: Contraction,
    }

    impl<'a> Both<'a> {
        fn new(graph: &'a DualGraph, ties: Ties) -> Self {
            let labels: Vec<u32> = (0..graph.faces() as u32).collect();
            let mut clusters = Clusters::new(graph, &graph.component_of_face());
            clusters.gather(graph, &labels);
            Self { graph, ties, labels, clusters, contraction: Contraction::new(graph, ties) }
        }

        /// The best dual edges, found among all edges of all faces.
        fn expected(&self) -> Vec<DualEdge> {
            let end = |cluster: u32| End {
                weight: self.clusters.sums(cluster).weight as u64,
                proxy: self.clusters.proxy(cluster),
            };
            let mut best: Vec<Option<(Rank<u32>, DualEdge)>> = vec![None; self.graph.faces()];
            for face in 0..self.graph.faces() as u32 {
                let cluster = self.labels[face as usize];
                for &near in self.graph.neighbours_of(face) {
                    let other = self.labels[near as usize];
                    let cost = packed_cost(end(cluster), end(other), self.clusters.energy_shift(cluster));
                    let rank = Rank::new(cost, cluster, other, self.ties);
                    let best = &mut best[cluster as usize];
                    if other != cluster && best.is_none_or(|(best, _)| rank < best) {
                        *best = Some((rank, DualEdge { cluster, other, cost }));
                    }
                }
            }
            best.into_iter().flatten().map(|(_, edge)| edge).collect()
        }

        /// Merges, after making sure that what is found is right; returns the best dual edges before.
        fn merge(&mut self, choose: impl FnOnce(&[DualEdge]) -> Vec<(u32, u32)>) -> Vec<DualEdge> {
            let edges = self.expected();
            assert_eq!(self.contraction.best(&self.clusters), edges);
            let mut pairs = self.contraction.mutual(&self.clusters);
            pairs.sort_unstable();
            assert_eq!(pairs, mutual(&edges));
            let pairs = choose(&edges);
            self.contraction.merge(&self.clusters, &pairs);
            for &(from, into) in &pairs {
                self.clusters.merge(into, from);
                self.labels.iter_mut().filter(|label| **label == from).for_each(|label| *label = into);
            }
            self.clusters.refit();
            edges
        }
    }

    /// Faces with such dual edges between them, in components of so many with such energy shifts.
    fn graph_of(
        centroids: Vec<[i32; 3]>,
        weights: Vec<u32>,
        edges: &[[u32; 2]],
        components: &[(u32, u32)],
    ) -> DualGraph {
        let mut directed: Vec<[u32; 2]> = edges.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        directed.sort_unstable();
        directed.dedup();
        let first = |face: usize| directed.partition_point(|edge| (edge[0] as usize) < face) as u32;
        let mut first_face = 0;
        let mut component = |&(faces, energy_shift): &(u32, u32)| {
            let range = first_face as usize..(first_face + faces) as usize;
            let weight = weights[range].iter().map(|&weight| u64::from(weight)).sum();
            first_face += faces;
            Component { first_face: first_face - faces, faces, weight, energy_shift }
        };
        DualGraph {
            components: components.iter().map(&mut component).collect(),
            neighbour_offsets: (0..=centroids.len()).map(first).collect(),
            neighbours: directed.iter().map(|edge| edge[1]).collect(),
            centroids,
            weights,
        }
    }

    /// The dual edges of a grid of squares, from such a face on.
    fn grid(side: u32, first: u32) -> Vec<[u32; 2]> {
        let face = |x: u32, y: u32| first + y * side + x;
        let across = (0..side).flat_map(|y| (1..side).map(move |x| [face(x - 1, y), face(x, y)]));
        let along = (1..side).flat_map(|y| (0..side).map(move |x| [face(x, y - 1), face(x, y)]));
        across.chain(along).collect()
    }

    /// A number below a limit, other ones at each call.
    fn random(state: &mut u64, below: u64) -> u64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) % below
    }

    /// Some of the best dual edges, whether or not they were chosen from both sides, none of them beside another.
    fn some(edges: &[DualEdge], state: &mut u64) -> Vec<(u32, u32)> {
        let mut taken = std::collections::HashSet::new();
        let mut pairs = Vec::new();
        for edge in edges {
            let is_free = !taken.contains(&edge.cluster) && !taken.contains(&edge.other);
            if is_free && (pairs.is_empty() || random(state, 3) == 0) {
                taken.extend([edge.cluster, edge.other]);
                let turned = random(state, 2) == 0;
                pairs.push(if turned { (edge.other, edge.cluster) } else { (edge.cluster, edge.other) });
            }
        }
        pairs
    }

    fn to_the_top(graph: &DualGraph, state: &mut u64) {
        for ties in [Ties::Hash, Ties::LargestId] {
            let mut both = Both::new(graph, ties);
            while !both.merge(|edges| some(edges, state)).is_empty() {}
        }
    }

    #[test]
    fn whatever_merges_on_a_grid_of_equal_squares_ties_go_by_the_rule() {
        let side = 18;
        let centroids = (0..side * side).map(|face| [1000 * (face % side) as i32, 1000 * (face / side) as i32, 0]);
        let graph = graph_of(centroids.collect(), vec![7; (side * side) as usize], &grid(side, 0), &[(side * side, 0)]);
        to_the_top(&graph, &mut 1);
    }

    #[test]
    fn costs_that_single_precision_does_not_tell_apart_go_by_packed_costs() {
        // far away in one of two places, all as heavy: distances and weights differ by some 2⁻²⁴
        let side = 14;
        let (mut state, mut weight_state) = (3, 9);
        let mut centroid = |face: u32| {
            let far = if (face / side + face % side).is_multiple_of(2) { 60_000_000 } else { -60_000_000 };
            [far + random(&mut state, 9) as i32, random(&mut state, 5000) as i32, 0]
        };
        let centroids = (0..side * side).map(&mut centroid).collect();
        let weights = (0..side * side).map(|_| (1 << 26) + random(&mut weight_state, 64) as u32).collect();
        let graph = graph_of(centroids, weights, &grid(side, 0), &[(side * side, 0)]);
        to_the_top(&graph, &mut 2);
    }

    #[test]
    fn folds_in_which_clusters_touch_that_lie_apart_are_no_exception() {
        // neighbours anywhere, so that a merge can bring a neighbour nearer to a third than either part was
        let mut state = 5;
        let (faces, parts) = (150, 3);
        let axis = |state: &mut u64| random(state, 1 << 27) as i32 - (1 << 26);
        let centroids = (0..faces * parts).map(|_| std::array::from_fn(|_| axis(&mut state))).collect();
        let weights = (0..faces * parts).map(|_| 1 + (random(&mut state, 1 << 29) >> random(&mut state, 29)) as u32);
        let weights = weights.collect();
        let mut edges = Vec::new();
        for part in 0..parts {
            for face in 1..faces {
                for _ in 0..2 {
                    let other = random(&mut state, u64::from(face)) as u32;
                    edges.push([part * faces + other, part * faces + face]);
                }
            }
        }
        let components: Vec<(u32, u32)> = (0..parts).map(|part| (faces, 7 * part)).collect();
        to_the_top(&graph_of(centroids, weights, &edges, &components), &mut 4);
    }

    #[test]
    fn merged_to_the_top_the_best_dual_edges_are_those_of_the_faces() {
        for (sample, faces) in [(Sample::Sphere, 1500), (Sample::Strip, 400), (Sample::Cube, 600), (Sample::Parts, 900)]
        {
            let surface = Surface::build(&generate(sample, faces).expect("a mesh")).expect("a surface");
            for ties in [Ties::Hash, Ties::LargestId] {
                let mut both = Both::new(&surface.graph, ties);
                let mut edges = surface.faces();
                while edges > 0 {
                    let choose =
                        |edges: &[DualEdge]| mutual(edges).iter().map(Rank::ends).map(|(a, b)| (b, a)).collect();
                    edges = both.merge(choose).len();
                }
                let left = surface.components.len();
                assert_eq!(both.contraction.rows.len() - both.contraction.ended, left, "{}", sample.name());
            }
        }
    }

    #[test]
    fn a_cluster_with_many_neighbours_is_no_exception() {
        let surface = Surface::build(&generate(Sample::Sphere, 3000).expect("a mesh")).expect("a surface");
        let mut both = Both::new(&surface.graph, Ties::Hash);
        let hub = 700;
        let mut most = 0;
        for _ in 0..900 {
            both.merge(|edges| {
                let at = edges.binary_search_by_key(&hub, |edge| edge.cluster).expect("the hub has neighbours");
                vec![(edges[at].other, hub)]
            });
            both.contraction.update(&both.clusters);
            let node = both.contraction.node_of_cluster[hub as usize];
            most = most.max(both.contraction.rows[node as usize].len as usize);
        }
        assert!(most > 64, "{most} neighbours");
    }

    #[test]
    fn a_star_takes_no_more_memory_than_its_edges() {
        let leaves = 3000;
        let around = (0..leaves as i32).map(|leaf| [leaf * leaf % 997, leaf, 7 * leaf % 31]);
        let centroids = std::iter::once([500, 1500, 0]).chain(around).collect();
        let spokes: Vec<[u32; 2]> = (1..=leaves as u32).map(|leaf| [0, leaf]).collect();
        let graph = graph_of(centroids, vec![1; leaves + 1], &spokes, &[(leaves as u32 + 1, 0)]);
        let mut both = Both::new(&graph, Ties::Hash);
        let mut most = 0;
        for _ in 0..leaves / 3 {
            let merged = both.merge(|edges| mutual(edges).iter().map(Rank::ends).map(|(a, b)| (b, a)).collect());
            assert!(merged.len() > 1);
            most = most.max(both.contraction.edges.capacity());
        }
        assert!(most < 20 * leaves, "room for {most} edges");
    }
}
