use super::*;
use crate::dev::random;
use crate::dev::sample::{Sample, generate};
use crate::device::cpu::best_edge;
use crate::device::dual_edge::{self, Rank};
use crate::device::plain;
use crate::device::{DualEdge, MergeSteps};
use crate::energy::Energy;
use crate::surface::{Component, Rows, Surface};

/// Clusters and their contraction, and the plain device that they are compared with.
struct Both<'a> {
    ties: Ties,
    plain: Box<dyn MergeSteps + 'a>,
    clusters: Clusters<Energy>,
    contraction: Contraction<Energy>,
}

impl<'a> Both<'a> {
    fn new(graph: &'a DualGraph, component_of_face: &'a [u32], ties: Ties) -> Self {
        let labels: Vec<u32> = (0..graph.faces() as u32).collect();
        let mut plain = plain::open(graph, component_of_face);
        plain.set_labels(&labels).expect("labels");
        let clusters = Clusters::of(graph, component_of_face, &labels);
        Self { ties, plain, clusters, contraction: Contraction::new(graph, ties) }
    }

    /// Merges, after making sure that what is found is right; returns the best dual edges before.
    fn merge(&mut self, choose: impl FnOnce(&[DualEdge]) -> Vec<(u32, u32)>) -> Vec<DualEdge> {
        let edges = self.plain.optimal_dual_edges(self.ties).expect("edges");
        let choices = self.contraction.choices(&self.clusters);
        assert_eq!(best_edge::optimal(&self.clusters, &choices), edges);
        let mut pairs = self.contraction.mutual(&self.clusters);
        pairs.sort_unstable();
        assert_eq!(pairs, mutual(&edges));
        let pairs = choose(&edges);
        self.contraction.merge(&pairs);
        self.plain.merge(&pairs).expect("merges");
        self.clusters.merge(&pairs);
        edges
    }
}

/// Faces with such dual edges between them, in components of so many with such energy shifts.
fn graph_of(points: Vec<[i32; 3]>, weights: Vec<u32>, edges: &[[u32; 2]], components: &[(u32, u32)]) -> DualGraph {
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
        neighbours: Rows {
            offsets: (0..=points.len()).map(first).collect(),
            items: directed.iter().map(|edge| edge[1]).collect(),
        },
        points,
        weights,
        moves: crate::surface::Moves::Free,
    }
}

/// The dual edges of a grid of squares, from such a face on.
fn grid(side: u32, first: u32) -> Vec<[u32; 2]> {
    let face = |x: u32, y: u32| first + y * side + x;
    let across = (0..side).flat_map(|y| (1..side).map(move |x| [face(x - 1, y), face(x, y)]));
    let along = (1..side).flat_map(|y| (0..side).map(move |x| [face(x, y - 1), face(x, y)]));
    across.chain(along).collect()
}

/// Numbers below a limit, other ones at each call.
fn numbers(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut states = random(seed);
    move |limit| (states() >> 33) % limit
}

/// The mutual pairs, the cheapest first.
fn mutual(edges: &[DualEdge]) -> Vec<Rank<u32>> {
    let mut pairs = dual_edge::mutual(edges, &mut Vec::new());
    pairs.sort_unstable();
    pairs
}

/// Some of the best dual edges, mutual or not, no two of which touch.
fn some(edges: &[DualEdge], next: &mut impl FnMut(u64) -> u64) -> Vec<(u32, u32)> {
    let mut taken = std::collections::HashSet::new();
    let mut pairs = Vec::new();
    for edge in edges {
        let is_free = !taken.contains(&edge.cluster) && !taken.contains(&edge.other);
        if is_free && (pairs.is_empty() || next(3) == 0) {
            taken.extend([edge.cluster, edge.other]);
            let turned = next(2) == 0;
            pairs.push(if turned { (edge.other, edge.cluster) } else { (edge.cluster, edge.other) });
        }
    }
    pairs
}

fn to_the_top(graph: &DualGraph, next: &mut impl FnMut(u64) -> u64) {
    for ties in [Ties::Hash, Ties::LargestId] {
        let component_of_face = graph.component_of_face();
        let mut both = Both::new(graph, &component_of_face, ties);
        while !both.merge(|edges| some(edges, next)).is_empty() {}
    }
}

#[test]
fn whatever_merges_on_a_grid_of_equal_squares_ties_go_by_the_rule() {
    let side = 18;
    let points = (0..side * side).map(|face| [1000 * (face % side) as i32, 1000 * (face / side) as i32, 0]);
    let graph = graph_of(points.collect(), vec![7; (side * side) as usize], &grid(side, 0), &[(side * side, 0)]);
    to_the_top(&graph, &mut numbers(1));
}

#[test]
fn costs_that_are_equal_in_single_precision_go_by_packed_costs() {
    // far away in one of two places, all as heavy: distances and weights differ by some 2⁻²⁴
    let side = 14;
    let (mut next, mut weight) = (numbers(3), numbers(9));
    let mut point = |face: u32| {
        let far = if (face / side + face % side).is_multiple_of(2) { 60_000_000 } else { -60_000_000 };
        [far + next(9) as i32, next(5000) as i32, 0]
    };
    let points = (0..side * side).map(&mut point).collect();
    let weights = (0..side * side).map(|_| (1 << 26) + weight(64) as u32).collect();
    let graph = graph_of(points, weights, &grid(side, 0), &[(side * side, 0)]);
    to_the_top(&graph, &mut numbers(2));
}

#[test]
fn folds_in_which_clusters_touch_that_lie_apart_are_no_exception() {
    // neighbours anywhere, so that a merge can bring a neighbour nearer to a third than either part was
    let mut next = numbers(5);
    let (faces, parts) = (150, 3);
    let points = (0..faces * parts).map(|_| std::array::from_fn(|_| next(1 << 27) as i32 - (1 << 26))).collect();
    let weights = (0..faces * parts).map(|_| 1 + (next(1 << 29) >> next(29)) as u32);
    let weights = weights.collect();
    let mut edges = Vec::new();
    for part in 0..parts {
        for face in 1..faces {
            for _ in 0..2 {
                let other = next(u64::from(face)) as u32;
                edges.push([part * faces + other, part * faces + face]);
            }
        }
    }
    let components: Vec<(u32, u32)> = (0..parts).map(|part| (faces, 7 * part)).collect();
    to_the_top(&graph_of(points, weights, &edges, &components), &mut numbers(4));
}

#[test]
fn merged_to_the_top_the_best_dual_edges_are_those_of_the_faces() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().expect("threads");
    pool.install(merge_samples_to_the_top);
}

fn merge_samples_to_the_top() {
    // in the largest, several threads search at once
    for (sample, faces) in [
        (Sample::Sphere, 1500),
        (Sample::Strip, 400),
        (Sample::Cube, 600),
        (Sample::Parts, 900),
        (Sample::Knot, 12_000),
    ] {
        let surface = Surface::build(&generate(sample, faces).expect("a mesh")).expect("a surface");
        let component_of_face = surface.component_of_face();
        for ties in [Ties::Hash, Ties::LargestId] {
            let mut both = Both::new(&surface.graph, &component_of_face, ties);
            let mut edges = surface.faces();
            while edges > 0 {
                let choose = |edges: &[DualEdge]| mutual(edges).iter().map(Rank::ends).map(|(a, b)| (b, a)).collect();
                edges = both.merge(choose).len();
            }
            let living = (0..).zip(&both.contraction.nodes).filter(|(number, node)| node.status.into == *number);
            assert_eq!(living.count(), surface.components.len(), "{}", sample.name());
        }
    }
}

#[test]
fn a_cluster_with_many_neighbours_is_no_exception() {
    let surface = Surface::build(&generate(Sample::Sphere, 3000).expect("a mesh")).expect("a surface");
    let component_of_face = surface.component_of_face();
    let mut both = Both::new(&surface.graph, &component_of_face, Ties::Hash);
    let hub = 700;
    let mut most = 0;
    for _ in 0..900 {
        both.merge(|edges| {
            let at = edges.binary_search_by_key(&hub, |edge| edge.cluster).expect("the hub has neighbours");
            vec![(edges[at].other, hub)]
        });
        both.contraction.update(&both.clusters);
        most = most.max(both.contraction.rows[hub as usize].edges().len());
    }
    assert!(most > 64, "{most} neighbours");
}

#[test]
fn a_star_takes_no_more_memory_than_its_edges() {
    let leaves = 3000;
    let around = (0..leaves as i32).map(|leaf| [leaf * leaf % 997, leaf, 7 * leaf % 31]);
    let points = std::iter::once([500, 1500, 0]).chain(around).collect();
    let spokes: Vec<[u32; 2]> = (1..=leaves as u32).map(|leaf| [0, leaf]).collect();
    let graph = graph_of(points, vec![1; leaves + 1], &spokes, &[(leaves as u32 + 1, 0)]);
    let component_of_face = graph.component_of_face();
    let mut both = Both::new(&graph, &component_of_face, Ties::Hash);
    let mut most = 0;
    for _ in 0..leaves / 3 {
        let merged = both.merge(|edges| mutual(edges).iter().map(Rank::ends).map(|(a, b)| (b, a)).collect());
        assert!(merged.len() > 1);
        most = most.max(both.contraction.edges.capacity());
    }
    assert!(most < 20 * leaves, "room for {most} edges");
}
