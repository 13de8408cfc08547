//! Clusters as lists of their faces, with exact sums: what moves of whole clusters work on.
//!
//! Devices keep labels and sums for moves of single faces, all at once. A merge or a split reads one cluster whole, and
//! few of them pay, so this state is kept on the host. Every cluster is connected, and every change keeps that.
//!
//! Energies are compared in one unit, that of the finest component: a number of a component is shifted left by its
//! `energy_shift`. Only the explained part of F is kept, because no labels change the rest.

use rayon::prelude::*;

use super::connection::Connection;
use crate::device::FREE;
use crate::energy::{ClusterSums, Energy, Functional, Item, LatticeEnergy, Proxy, Sums};
use crate::surface::DualGraph;

/// Clusters of a chunk.
pub(super) const CHUNK: usize = 64;

/// A clustering of a graph. Numbers of clusters may be free: [`compacted`](Self::compacted) closes the gaps.
#[derive(Debug, Clone)]
pub struct Clusters<'a> {
    pub(super) graph: &'a DualGraph,
    labels: Vec<u32>,
    /// Where each face stands in the list of its cluster.
    place_of_face: Vec<u32>,
    all: Vec<Cluster>,
    free_numbers: Vec<u32>,
    explained: i128,
    moves: u64,
    touched: Touched,
    connection: Connection,
}

/// A cluster.
#[derive(Debug, Clone, Default)]
struct Cluster {
    faces: Vec<u32>,
    sums: ClusterSums,
    /// The part of F that no labels change.
    constant: i128,
    fit: Fit,
    /// The `energy_shift` of its component.
    shift: u32,
}

impl Cluster {
    /// Counts a face in (1) or out (−1); the proxy is not fitted.
    fn count(&mut self, face: Item, sign: i64) {
        self.sums.add_face(face, sign);
        self.constant += Energy::constant(face) * i128::from(sign);
    }
}

/// A proxy, and what it explains ([`Sums::fit`]).
type Fit = (Proxy, i128);

/// Clusters that gained or lost a face, each once.
#[derive(Debug, Clone, Default)]
struct Touched {
    list: Vec<u32>,
    is_listed: Vec<bool>,
}

impl Touched {
    fn add(&mut self, cluster: u32) {
        if !std::mem::replace(&mut self.is_listed[cluster as usize], true) {
            self.list.push(cluster);
        }
    }

    fn take(&mut self) -> Vec<u32> {
        self.list.iter().for_each(|&cluster| self.is_listed[cluster as usize] = false);
        let mut list = std::mem::take(&mut self.list);
        list.sort_unstable();
        list
    }
}

impl<'a> Clusters<'a> {
    /// From labels in which every face has one. All clusters count as touched.
    pub fn new(graph: &'a DualGraph, labels: Vec<u32>) -> Self {
        let numbers = labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0);
        let mut sizes = vec![0; numbers];
        labels.iter().for_each(|&label| sizes[label as usize] += 1);
        let with_room = |&size: &usize| Cluster { faces: Vec::with_capacity(size), ..Cluster::default() };
        let mut all: Vec<Cluster> = sizes.iter().map(with_room).collect();
        let mut place_of_face = vec![0; labels.len()];
        for component in &graph.components {
            for face in component.range() {
                let cluster = &mut all[labels[face] as usize];
                place_of_face[face] = cluster.faces.len() as u32;
                cluster.faces.push(face as u32);
                cluster.shift = component.energy_shift;
            }
        }
        all.par_iter_mut().with_min_len(CHUNK).for_each(|cluster| {
            for at in 0..cluster.faces.len() {
                cluster.count(graph.face(cluster.faces[at] as usize), 1);
            }
            cluster.fit = cluster.sums.fit().unwrap_or_default();
        });
        let explained = all.iter().map(|cluster| cluster.fit.1 << cluster.shift).sum();
        let free_numbers = (0..numbers as u32).rev().filter(|&number| sizes[number as usize] == 0).collect();
        let touched = Touched { list: (0..numbers as u32).collect(), is_listed: vec![true; numbers] };
        let connection = Connection::new(labels.len());
        Self { graph, labels, place_of_face, all, free_numbers, explained, moves: 0, touched, connection }
    }

    /// One past the largest number of a cluster.
    pub fn numbers(&self) -> usize {
        self.all.len()
    }

    /// How many clusters there are.
    pub fn count(&self) -> usize {
        self.all.len() - self.free_numbers.len()
    }

    /// The cluster of each face.
    pub fn labels(&self) -> &[u32] {
        &self.labels
    }

    /// The cluster of a face.
    pub fn label(&self, face: u32) -> u32 {
        self.labels[face as usize]
    }

    /// The labels, without gaps between the numbers.
    pub fn compacted(&self) -> Vec<u32> {
        let mut next = 0;
        let number = |cluster: &Cluster| {
            next += u32::from(!cluster.faces.is_empty());
            if cluster.faces.is_empty() { FREE } else { next - 1 }
        };
        let new: Vec<u32> = self.all.iter().map(number).collect();
        self.labels.iter().map(|&label| new[label as usize]).collect()
    }

    /// The faces of a cluster, in no particular order; none of a number that is free.
    pub fn faces(&self, cluster: u32) -> &[u32] {
        &self.all[cluster as usize].faces
    }

    /// The `energy_shift` of a cluster's component.
    pub fn shift(&self, cluster: u32) -> u32 {
        self.all[cluster as usize].shift
    }

    /// F, of all clusters.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.explained }
    }

    /// What a cluster explains of F.
    pub fn explained(&self, cluster: u32) -> i128 {
        let Cluster { fit, shift, .. } = &self.all[cluster as usize];
        fit.1 << shift
    }

    /// F of a cluster. No split gains more.
    pub fn energy_of(&self, cluster: u32) -> i128 {
        let Cluster { constant, fit, shift, .. } = &self.all[cluster as usize];
        (constant - fit.1) << shift
    }

    /// F of all clusters.
    pub fn total(&self) -> i128 {
        (0..self.numbers() as u32).map(|cluster| self.energy_of(cluster)).sum()
    }

    /// What merging two clusters of one component raises F by.
    pub fn merge_cost(&self, a: u32, b: u32) -> i128 {
        let [a, b] = [a, b].map(|cluster| &self.all[cluster as usize]);
        let mut sums = a.sums;
        sums.add(&b.sums, 1);
        let (_, explained) = sums.fit().unwrap_or_default();
        (a.fit.1 + b.fit.1 - explained) << a.shift
    }

    /// The clusters beside a cluster, ascending.
    pub fn beside(&self, cluster: u32) -> Vec<u32> {
        // most have no more entries than that
        let mut beside = Vec::with_capacity(self.faces(cluster).len() + 2);
        let mut last = cluster;
        for &face in self.faces(cluster) {
            for &near in self.graph.neighbours_of(face) {
                let label = self.label(near);
                if label != cluster && label != last {
                    beside.push(label);
                    last = label;
                }
            }
        }
        beside.sort_unstable();
        beside.dedup();
        beside
    }

    /// A number for a cluster that is to be made.
    pub fn free_number(&mut self) -> u32 {
        self.free_numbers.pop().unwrap_or_else(|| {
            self.all.push(Cluster::default());
            self.touched.is_listed.push(false);
            self.all.len() as u32 - 1
        })
    }

    /// Merges two neighbouring clusters. The one with fewer faces (the larger number of equal ones) becomes part of the
    /// other, and its number free. Returns the other.
    pub fn merge(&mut self, a: u32, b: u32) -> u32 {
        let size = |cluster: u32| self.faces(cluster).len();
        let (into, from) = if size(a) > size(b) || (size(a) == size(b) && a < b) { (a, b) } else { (b, a) };
        let faces = std::mem::take(&mut self.all[from as usize].faces);
        self.hand_over(&faces, from, into);
        self.free_numbers.push(from);
        into
    }

    /// Makes a cluster of some faces of a cluster, but not all, and returns its number.
    pub fn split(&mut self, cluster: u32, leaving: &[u32]) -> u32 {
        let number = self.free_number();
        self.all[number as usize].shift = self.all[cluster as usize].shift;
        for &face in leaving {
            self.take_from_list(face, cluster);
        }
        self.hand_over(leaving, cluster, number);
        number
    }

    /// Gives faces other clusters of their component. A cluster that loses all faces gets free; all others must be
    /// connected afterwards. A number from [`free_number`](Self::free_number) is a new cluster.
    pub fn relabel(&mut self, faces: &[u32], labels: &[u32]) {
        let mut changed = Vec::new();
        for (&face, &to) in faces.iter().zip(labels) {
            let from = self.label(face);
            if from != to {
                self.take_from_list(face, from);
                self.push_to_list(face, to);
                for (cluster, sign) in [(from, -1), (to, 1)] {
                    self.all[cluster as usize].count(self.graph.face(face as usize), sign);
                }
                self.all[to as usize].shift = self.all[from as usize].shift;
                self.note_change(from, to, 1);
                changed.extend([from, to]);
            }
        }
        changed.sort_unstable();
        changed.dedup();
        for cluster in changed {
            self.fit(cluster);
            if self.faces(cluster).is_empty() {
                self.free_numbers.push(cluster);
            }
        }
    }

    /// Moves a face to a neighbouring cluster, if that lowers F, leaves a face behind, and does not cut its cluster in
    /// pieces.
    pub fn move_if_lower(&mut self, face: u32, to: u32) -> bool {
        let from = self.label(face);
        let [a, b] = [from, to].map(|cluster| &self.all[cluster as usize]);
        let (mut without, mut with) = (a.sums, b.sums);
        without.add_face(self.graph.face(face as usize), -1);
        with.add_face(self.graph.face(face as usize), 1);
        let (Some(fit_without), Some(fit_with)) = (without.fit(), with.fit()) else { return false };
        let fall = fit_without.1 + fit_with.1 - a.fit.1 - b.fit.1;
        let shift = a.shift;
        let Self { graph, labels, connection, .. } = self;
        if fall <= 0 || !connection.stays_without(graph, face, |near| labels[near as usize] == from) {
            return false;
        }
        self.take_from_list(face, from);
        self.push_to_list(face, to);
        let of = |cluster: u32| cluster as usize;
        (self.all[of(from)].sums, self.all[of(from)].fit) = (without, fit_without);
        (self.all[of(to)].sums, self.all[of(to)].fit) = (with, fit_with);
        let constant = Energy::constant(self.graph.face(face as usize));
        self.all[of(from)].constant -= constant;
        self.all[of(to)].constant += constant;
        self.explained += fall << shift;
        self.note_change(from, to, 1);
        true
    }

    /// The proxy and the weight of a cluster.
    pub fn proxy_and_weight(&self, cluster: u32) -> (Proxy, u64) {
        let Cluster { fit, sums, .. } = &self.all[cluster as usize];
        (fit.0, sums.weight())
    }

    /// Takes the clusters that gained or lost a face since the last call, ascending.
    pub fn take_touched(&mut self) -> Vec<u32> {
        self.touched.take()
    }

    /// Takes the number of faces that changed their cluster since the last call.
    pub fn take_moves(&mut self) -> u64 {
        std::mem::take(&mut self.moves)
    }

    /// Takes a face from the list of its cluster; the last one gets its place.
    fn take_from_list(&mut self, face: u32, cluster: u32) {
        let place = self.place_of_face[face as usize];
        let faces = &mut self.all[cluster as usize].faces;
        faces.swap_remove(place as usize);
        if let Some(&last) = faces.get(place as usize) {
            self.place_of_face[last as usize] = place;
        }
    }

    fn push_to_list(&mut self, face: u32, cluster: u32) {
        let faces = &mut self.all[cluster as usize].faces;
        self.place_of_face[face as usize] = faces.len() as u32;
        faces.push(face);
        self.labels[face as usize] = cluster;
    }

    /// Gives faces of a cluster, which are in no list any more, to another one.
    fn hand_over(&mut self, faces: &[u32], from: u32, to: u32) {
        let mut moved = Cluster::default();
        for &face in faces {
            self.push_to_list(face, to);
            moved.count(self.graph.face(face as usize), 1);
        }
        for (cluster, sign) in [(from, -1), (to, 1)] {
            let Cluster { sums, constant, .. } = &mut self.all[cluster as usize];
            sums.add(&moved.sums, sign);
            *constant += moved.constant * i128::from(sign);
            self.fit(cluster);
        }
        self.note_change(from, to, faces.len() as u64);
    }

    /// Fits the proxy of a cluster whose sums have changed.
    fn fit(&mut self, cluster: u32) {
        let Cluster { sums, fit, shift, .. } = &mut self.all[cluster as usize];
        let before = std::mem::replace(fit, sums.fit().unwrap_or_default());
        self.explained += (fit.1 - before.1) << *shift;
    }

    fn note_change(&mut self, from: u32, to: u32, moves: u64) {
        self.touched.add(from);
        self.touched.add(to);
        self.moves += moves;
    }
}
