//! The best way to split a cluster in two connected parts, of those that are tried.
//!
//! # Definition
//!
//! Two splits are tried; both work on the dual graph of the cluster's faces.
//!
//! 1. *Cut of a tree.* A minimum spanning tree by the merge cost of faces (Prim, from the face with the smallest
//!    number) is cut at the edge that gains most. Sums over subtrees give the gain of every edge in one pass.
//! 2. *Growth from the ends.* The face farthest from the proxy, and the face farthest from that one, grow until they
//!    have all faces: next is the face with the smallest d²(own) − d²(other), the squared distances to both.
//!
//! Then faces move between the sides, in up to [`PASSES`] passes over all faces in their order, where F₁ + F₂ falls and
//! both sides stay connected. The split with the larger gain F − F₁ − F₂ is taken, the first of equal ones. Other ties
//! go by the number of the face. The result depends on the cluster's faces only.
//!
//! # Why two
//!
//! The tree finds the gap between two groups of heavy faces; the growth finds the middle of even faces, where all edges
//! of a tree cost the same. With either alone, energies of uneven meshes end higher.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::cluster::connected::Connection;
use crate::energy::{Functional, Sums};
use crate::surface::{Component, DualGraph, Rows};

/// Passes of moves between the sides, at most.
const PASSES: usize = 12;

/// A split of a cluster.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split {
    /// What it lowers F by, in the unit of the finest component.
    pub gain: i128,
    /// The faces that leave; the face with the smallest number stays.
    pub leaving: Vec<u32>,
}

impl Split {
    /// The better split of a connected cluster, given by its faces, ascending. None for a single face.
    pub fn of<E: Functional>(graph: &DualGraph<E>, faces: &[u32], energy_shift: u32) -> Option<Self> {
        if faces.len() < 2 {
            return None;
        }
        let part = restricted(graph, faces, energy_shift);
        let cut = Sides::by_tree(&part).improved();
        let grown = if faces.len() > 2 { Sides::by_growth(&part).map(Sides::improved) } else { None };
        let best = grown.filter(|grown| grown.explained() > cut.explained()).unwrap_or(cut);
        let stays = best.is_second[0];
        let leaving = faces.iter().zip(&best.is_second).filter(|&(_, &side)| side != stays).map(|(&face, _)| face);
        Some(Self { gain: (best.explained() - best.whole().explained()) << energy_shift, leaving: leaving.collect() })
    }
}

/// The graph of some faces of a component, given ascending; they keep their order.
pub fn restricted<E: Functional>(graph: &DualGraph<E>, faces: &[u32], energy_shift: u32) -> DualGraph<E> {
    let mut part = DualGraph {
        points: faces.iter().map(|&face| graph.points[face as usize]).collect(),
        weights: faces.iter().map(|&face| graph.weights[face as usize]).collect(),
        neighbours: Rows { offsets: Vec::with_capacity(faces.len() + 1), items: Vec::with_capacity(3 * faces.len()) },
        components: Vec::new(),
        moves: graph.moves,
    };
    part.neighbours.offsets.push(0);
    for &face in faces {
        let places = graph.neighbours_of(face).iter().filter_map(|near| faces.binary_search(near).ok());
        part.neighbours.push(places.map(|place| place as u32));
    }
    let weight = part.weights.iter().map(|&weight| u64::from(weight)).sum();
    part.components.push(Component { first_face: 0, faces: faces.len() as u32, weight, energy_shift });
    part
}

/// A split, as the side of each face.
struct Sides<'a, E: Functional> {
    graph: &'a DualGraph<E>,
    is_second: Vec<bool>,
    sums: [E::Sums; 2],
}

impl<'a, E: Functional> Sides<'a, E> {
    fn new(graph: &'a DualGraph<E>, is_second: Vec<bool>) -> Self {
        let mut sums = [E::Sums::default(); 2];
        for (face, &side) in is_second.iter().enumerate() {
            sums[usize::from(side)].add_face(graph.face(face), 1);
        }
        Self { graph, is_second, sums }
    }

    fn whole(&self) -> E::Sums {
        let mut whole = self.sums[0];
        whole.add(&self.sums[1], 1);
        whole
    }

    fn explained(&self) -> i128 {
        self.sums.iter().map(Sums::explained).sum()
    }

    /// The best cut of a minimum spanning tree.
    fn by_tree(graph: &'a DualGraph<E>) -> Self {
        let (order, parent) = minimum_spanning_tree(graph);
        let mut below: Vec<E::Sums> = (0..graph.faces() as u32).map(|face| graph.sums_over([face])).collect();
        for &face in order[1..].iter().rev() {
            let sums = below[face as usize];
            below[parent[face as usize] as usize].add(&sums, 1);
        }
        let gain = |&face: &u32| {
            let mut rest = below[0];
            rest.add(&below[face as usize], -1);
            (rest.explained() + below[face as usize].explained(), Reverse(face))
        };
        let top = order[1..].iter().copied().max_by_key(gain).unwrap_or(0);
        let mut is_second = vec![false; graph.faces()];
        is_second[top as usize] = true;
        for &face in &order[1..] {
            is_second[face as usize] |= is_second[parent[face as usize] as usize];
        }
        Self::new(graph, is_second)
    }

    /// Growth from two ends; None where all faces lie at one place.
    fn by_growth(graph: &'a DualGraph<E>) -> Option<Self> {
        let faces = graph.faces() as u32;
        let point = |face: u32| graph.points[face as usize];
        let farthest = |from| (0..faces).max_by_key(|&face| (E::cost(point(face), from), Reverse(face)));
        let first = farthest(graph.sums_over(0..faces).proxy()?)?;
        let second = farthest(point(first))?;
        if point(first) == point(second) {
            return None;
        }
        let ends = [first, second].map(point);
        let mut side_of: Vec<Option<bool>> = vec![None; faces as usize];
        let mut queue = BinaryHeap::from([Reverse((i64::MIN, first, false)), Reverse((i64::MIN, second, true))]);
        while let Some(Reverse((_, face, side))) = queue.pop() {
            if side_of[face as usize].is_some() {
                continue;
            }
            side_of[face as usize] = Some(side);
            for &near in graph.neighbours_of(face).iter().filter(|&&near| side_of[near as usize].is_none()) {
                let [own, other] =
                    [usize::from(side), usize::from(!side)].map(|end| E::cost(point(near), ends[end]) as i64);
                queue.push(Reverse((own - other, near, side)));
            }
        }
        Some(Self::new(graph, side_of.into_iter().map(|side| side == Some(true)).collect()))
    }

    /// Moves faces between the sides where F₁ + F₂ falls and both stay connected.
    fn improved(mut self) -> Self {
        let graph = self.graph;
        let mut connection = Connection::new(graph.faces(), graph.moves);
        let mut now = self.explained();
        for _ in 0..PASSES {
            let before = now;
            for face in 0..graph.faces() as u32 {
                let side = self.is_second[face as usize];
                let is_beside = graph.neighbours_of(face).iter().any(|&near| self.is_second[near as usize] != side);
                if !is_beside || self.sums[usize::from(side)].faces() == 1 {
                    continue;
                }
                let mut sums = self.sums;
                sums[usize::from(side)].add_face(graph.face(face as usize), -1);
                sums[usize::from(!side)].add_face(graph.face(face as usize), 1);
                let then = sums.iter().map(Sums::explained).sum();
                let is_own = |near: u32| self.is_second[near as usize] == side;
                if then > now && connection.stays_without(graph, face, is_own) {
                    (self.sums, now) = (sums, then);
                    self.is_second[face as usize] = !side;
                    connection.moved(graph, face);
                }
            }
            if now == before {
                break;
            }
        }
        self
    }
}

/// The faces in the order in which Prim's algorithm takes them, from face 0; and the parent of each, its own for the
/// first.
fn minimum_spanning_tree<E: Functional>(graph: &DualGraph<E>) -> (Vec<u32>, Vec<u32>) {
    let end = |face: u32| graph.sums_over([face]).end(graph.points[face as usize]);
    let mut order = Vec::with_capacity(graph.faces());
    let mut parent_of: Vec<Option<u32>> = vec![None; graph.faces()];
    let mut queue = BinaryHeap::from([Reverse((0, 0, 0))]);
    while let Some(Reverse((_, face, parent))) = queue.pop() {
        if parent_of[face as usize].is_some() {
            continue;
        }
        parent_of[face as usize] = Some(parent);
        order.push(face);
        for &near in graph.neighbours_of(face).iter().filter(|&&near| parent_of[near as usize].is_none()) {
            queue.push(Reverse((E::packed_merge_cost(end(face), end(near), 0), near, face)));
        }
    }
    let parent = parent_of.into_iter().map(Option::unwrap_or_default).collect();
    (order, parent)
}
