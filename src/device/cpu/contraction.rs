//! The graph of clusters, contracted as they merge: who lies beside whom, and what merging with them costs.
//!
//! It stands for the faces as long as none of them moves: in hierarchies without optimisation, and in the first round of the
//! others. A round then costs in proportion to the clusters that are left, however long their borders are,
//! and only the dual edges of clusters that have just merged are priced.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::clusters::Clusters;
use crate::cluster::dual_edge::{End, Rank, Ties, packed_cost};
use crate::device::DualEdge;
use crate::surface::DualGraph;

/// Nodes a thread takes at a time.
const CHUNK: usize = 1024;

/// The fate of a node that the last merges left as it was.
const UNCHANGED: u32 = u32::MAX;

/// In place of a node: none.
const NOBODY: u32 = u32::MAX;

/// Neighbours up to which a row is looked through for those that it has twice; longer ones are sorted.
const SHORT: usize = 64;

/// The living clusters, their neighbours and their best dual edges.
///
/// Here a cluster goes by the number of its node. Nodes are in the order of their clusters, and numbered anew when a quarter of
/// them have ended, so that those that are left lie close together.
#[derive(Debug)]
pub struct Contraction {
    nodes: Vec<Node>,
    cluster_of_node: Vec<u32>,
    /// By what the dual edges at each node are priced.
    ends: Vec<End>,
    /// The node of each cluster that has not ended.
    node_of_cluster: Vec<u32>,
    /// Rows of neighbours, and what no node needs any more. Each row is written by one thread at a time.
    edges: Vec<AtomicU64>,
    /// What the last merges made of each node, or [`UNCHANGED`].
    fates: Vec<u32>,
    /// Nodes that grew by the last merges, all of them at first.
    grown: Vec<u32>,
    /// Nodes that have ended.
    ended: usize,
    /// Edges when those were last let go that nobody needs.
    settled: usize,
    /// Which of equally cheap dual edges is the best.
    ties: Ties,
    /// Whether the rows and the best dual edges are those after the last merges.
    is_current: bool,
}

/// The row of a node.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// Its first edge.
    start: usize,
    /// Its edges.
    len: u32,
    has_ended: bool,
    best: Edge,
}

/// The node of a neighbour, or [`NOBODY`], and the packed cost of merging with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    other: u32,
    cost: u32,
}

impl Contraction {
    /// Of clusters that are a face each.
    pub fn new(graph: &DualGraph, ties: Ties) -> Self {
        let faces = graph.faces() as u32;
        let node = |face: u32| Node {
            start: graph.neighbour_offsets[face as usize] as usize,
            len: graph.neighbours_of(face).len() as u32,
            has_ended: false,
            best: Edge::NONE,
        };
        Self {
            nodes: (0..faces).map(node).collect(),
            cluster_of_node: (0..faces).collect(),
            ends: vec![End { weight: 0, proxy: [0; 3] }; graph.faces()],
            node_of_cluster: (0..faces).collect(),
            edges: graph.neighbours.iter().map(|&other| AtomicU64::new(Edge { other, cost: 0 }.packed())).collect(),
            fates: (0..faces).collect(),
            grown: (0..faces).collect(),
            ended: 0,
            settled: graph.neighbours.len(),
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
        let Self { nodes, cluster_of_node, .. } = self;
        let edge = |(node, &cluster): (&Node, &u32)| {
            let Edge { other, cost } = node.best;
            (other != NOBODY).then(|| DualEdge { cluster, other: cluster_of_node[other as usize], cost })
        };
        nodes.par_iter().zip(&*cluster_of_node).with_min_len(CHUNK).filter_map(edge).collect()
    }

    /// The pairs of clusters that chose each other, in no particular order.
    pub fn mutual(&mut self, clusters: &Clusters) -> Vec<Rank<u32>> {
        self.update(clusters);
        let Self { nodes, cluster_of_node, .. } = self;
        let pair = |(number, node): (usize, &Node)| {
            let Edge { other, cost } = node.best;
            let other = other as usize;
            let is_mutual = node.best != Edge::NONE && other > number && nodes[other].best.other as usize == number;
            is_mutual.then(|| Rank::new(cost, cluster_of_node[number], cluster_of_node[other], Ties::Hash))
        };
        nodes.par_iter().enumerate().with_min_len(CHUNK).filter_map(pair).collect()
    }

    /// Lets clusters become part of others, each the first of its pair of the second; no cluster is in two pairs. `clusters`
    /// do not know of it yet.
    pub fn merge(&mut self, clusters: &Clusters, pairs: &[(u32, u32)]) {
        // a row may name nodes that ended one merge ago, not two
        self.update(clusters);
        self.grown.iter().for_each(|&node| self.fates[node as usize] = UNCHANGED);
        self.grown.clear();
        // the second where a cluster with a long row grows little by little
        if self.ended > self.nodes.len() / 4 || self.edges.len() > 2 * self.settled + self.nodes.len() {
            self.compact();
        }
        let mut end = self.edges.len();
        let mut joined = Vec::with_capacity(pairs.len());
        for &(from, into) in pairs {
            let [into, from] = [into, from].map(|cluster| self.node_of_cluster[cluster as usize]);
            self.fates[from as usize] = into;
            self.fates[into as usize] = into;
            self.grown.push(into);
            let both = [into, from].map(|node| self.nodes[node as usize]);
            let len = both[0].len + both[1].len;
            joined.push((both, end));
            self.nodes[into as usize] = Node { start: end, len, ..both[0] };
            self.nodes[from as usize] = Node { len: 0, has_ended: true, best: Edge::NONE, ..both[1] };
            end += len as usize;
        }
        self.edges.resize_with(end, AtomicU64::default);
        let edges = &self.edges;
        joined.par_iter().with_min_len(CHUNK).for_each(|(both, start)| {
            let rows = both.iter().flat_map(|node| node.row(edges));
            edges[*start..].iter().zip(rows).for_each(|(target, edge)| target.store(edge.load(Relaxed), Relaxed));
        });
        self.ended += pairs.len();
        self.is_current = false;
    }

    /// Brings the rows in step with the last merges, and finds the best dual edges.
    fn update(&mut self, clusters: &Clusters) {
        if self.is_current {
            return;
        }
        for &node in &self.grown {
            let cluster = self.cluster_of_node[node as usize];
            let weight = clusters.sums(cluster).weight as u64;
            self.ends[node as usize] = End { weight, proxy: clusters.proxy(cluster) };
        }
        let Self { nodes, cluster_of_node, ends, edges, fates, ties, .. } = self;
        let context = Context { cluster_of_node, ends, edges, fates, clusters, ties: *ties };
        nodes.par_iter_mut().enumerate().with_min_len(CHUNK).for_each_init(Vec::new, |long, (number, node)| {
            node.update(number as u32, context, long);
        });
        self.is_current = true;
    }

    /// Lets go of nodes that have ended, and of edges that nobody needs. All rows are current, and none has grown.
    fn compact(&mut self) {
        let mut new_number = vec![NOBODY; self.nodes.len()];
        let mut left = Vec::with_capacity(self.nodes.len() - self.ended);
        let mut end = 0;
        for (number, node) in self.nodes.iter().enumerate().filter(|(_, node)| !node.has_ended) {
            let new = left.len() as u32;
            new_number[number] = new;
            self.node_of_cluster[self.cluster_of_node[number] as usize] = new;
            self.cluster_of_node[left.len()] = self.cluster_of_node[number];
            self.ends[left.len()] = self.ends[number];
            left.push((*node, end));
            end += node.len as usize;
        }
        self.cluster_of_node.truncate(left.len());
        self.ends.truncate(left.len());
        self.fates.truncate(left.len());
        self.fates.fill(UNCHANGED);
        self.ended = 0;

        let mut edges = Vec::new();
        edges.resize_with(end, AtomicU64::default);
        let renumbered = |best: Edge| match best.other {
            NOBODY => best,
            other => Edge { other: new_number[other as usize], ..best },
        };
        let settle = |(node, start): (Node, usize)| {
            for (target, edge) in edges[start..].iter().zip(node.row(&self.edges)) {
                target.store(renumbered(Edge::unpacked(edge.load(Relaxed))).packed(), Relaxed);
            }
            Node { start, best: renumbered(node.best), ..node }
        };
        self.nodes = left.into_par_iter().with_min_len(CHUNK).map(settle).collect();
        self.settled = edges.len();
        self.edges = edges;
    }
}

/// What the update of a node reads.
#[derive(Clone, Copy)]
struct Context<'a> {
    cluster_of_node: &'a [u32],
    ends: &'a [End],
    edges: &'a [AtomicU64],
    fates: &'a [u32],
    clusters: &'a Clusters,
    ties: Ties,
}

impl Context<'_> {
    /// Whether one edge of a node is better than another.
    fn prefers(&self, node: u32, edge: Edge, than: Edge) -> bool {
        if than == Edge::NONE || edge.cost != than.cost {
            return than == Edge::NONE || edge.cost < than.cost;
        }
        let cluster = |node: u32| self.cluster_of_node[node as usize];
        let rank = |edge: Edge| Rank::new(edge.cost, cluster(node), cluster(edge.other), self.ties);
        rank(edge) < rank(than)
    }
}

impl Node {
    fn row<'a>(&self, edges: &'a [AtomicU64]) -> &'a [AtomicU64] {
        &edges[self.start..][..self.len as usize]
    }

    /// Replaces neighbours that have ended by what they became part of, each once, prices the dual edges of those that grew,
    /// and finds the best of all.
    fn update(&mut self, number: u32, context: Context<'_>, long: &mut Vec<Edge>) {
        let Context { cluster_of_node, ends, edges, fates, clusters, .. } = context;
        if self.has_ended {
            return;
        }
        let row = self.row(edges);
        let has_grown = fates[number as usize] != UNCHANGED;
        let is_untouched = |edge: &AtomicU64| fates[Edge::unpacked(edge.load(Relaxed)).other as usize] == UNCHANGED;
        if !has_grown && row.iter().all(is_untouched) {
            return;
        }
        let shift = clusters.energy_shift(cluster_of_node[number as usize]);
        let price = |other: u32| Edge { other, cost: packed_cost(ends[number as usize], ends[other as usize], shift) };
        let mut best = Edge::NONE;
        let mut kept = 0;
        let mut keep = |edge: Edge| {
            row[kept].store(edge.packed(), Relaxed);
            kept += 1;
            if context.prefers(number, edge, best) {
                best = edge;
            }
        };
        if row.len() > SHORT {
            long.clear();
            long.extend(row.iter().map(|edge| {
                let edge = Edge::unpacked(edge.load(Relaxed));
                match fates[edge.other as usize] {
                    UNCHANGED => edge,
                    other => Edge { other, ..edge },
                }
            }));
            long.sort_unstable();
            long.dedup_by_key(|edge| edge.other);
            for &edge in long.iter().filter(|edge| edge.other != number) {
                let is_known = !has_grown && fates[edge.other as usize] == UNCHANGED;
                keep(if is_known { edge } else { price(edge.other) });
            }
        } else {
            let mut others = [NOBODY; SHORT];
            let mut seen = 0;
            for edge in row {
                let edge = Edge::unpacked(edge.load(Relaxed));
                let fate = fates[edge.other as usize];
                if fate == UNCHANGED && !has_grown {
                    keep(edge);
                    continue;
                }
                let other = if fate == UNCHANGED { edge.other } else { fate };
                if other != number && !others[..seen].contains(&other) {
                    others[seen] = other;
                    seen += 1;
                    keep(price(other));
                }
            }
        }
        self.len = kept as u32;
        self.best = best;
    }
}

impl Edge {
    const NONE: Self = Self { other: NOBODY, cost: u32::MAX };

    fn packed(self) -> u64 {
        u64::from(self.other) << 32 | u64::from(self.cost)
    }

    fn unpacked(packed: u64) -> Self {
        Self { other: (packed >> 32) as u32, cost: packed as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::dual_edge::mutual;
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
        fn merge(&mut self, choose: impl Fn(&[DualEdge]) -> Vec<(u32, u32)>) -> Vec<DualEdge> {
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
                assert_eq!(both.contraction.nodes.len() - both.contraction.ended, left, "{}", sample.name());
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
            let node = both.contraction.node_of_cluster[hub as usize];
            most = most.max(both.contraction.nodes[node as usize].len as usize);
        }
        assert!(most > SHORT, "{most} neighbours");
    }

    #[test]
    fn a_star_takes_no_more_memory_than_its_edges() {
        let leaves = 3000;
        let around = (0..leaves as i32).map(|leaf| [leaf * leaf % 997, leaf, 7 * leaf % 31]);
        let graph = DualGraph {
            centroids: std::iter::once([500, 1500, 0]).chain(around).collect(),
            weights: vec![1; leaves + 1],
            neighbour_offsets: std::iter::once(0).chain((0..=leaves as u32).map(|leaf| leaves as u32 + leaf)).collect(),
            neighbours: (1..=leaves as u32).chain(std::iter::repeat_n(0, leaves)).collect(),
            components: vec![Component {
                first_face: 0,
                faces: leaves as u32 + 1,
                weight: leaves as u64 + 1,
                energy_shift: 0,
            }],
        };
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
