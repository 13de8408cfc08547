//! Clusters as lists of their faces, with exact sums: what moves of whole clusters work on.
//!
//! Devices keep labels and sums for moves of single faces, all at once. A merge or a split reads one cluster whole, and
//! few of them pay, so this state is kept on the host. Every cluster is connected, and every change keeps that.
//!
//! Only the explained part of F is kept, because no labels change the rest.

use rayon::prelude::*;

use super::connection::Connection;
use super::totals::Totals;
use crate::device::{Ending, FREE};
use crate::energy::{Functional, LatticeEnergy, Sums};
use crate::surface::DualGraph;

/// Passes at most, those over some of the clusters counted by their faces, and by the neighbours of those at borders.
const PASSES: usize = 1024;

/// Neighbours that count as a face.
const NEIGHBOURS: usize = 4;

/// Clusters of a chunk.
pub(super) const CHUNK: usize = 64;

/// A clustering of a graph. Numbers of clusters may be free: [`compacted`](Self::compacted) closes the gaps.
#[derive(Debug, Clone)]
pub struct Clusters<'a, E: Functional> {
    pub(super) graph: &'a DualGraph<E>,
    labels: Vec<u32>,
    /// Where each face stands in the list of its cluster.
    place_of_face: Vec<u32>,
    all: Vec<Cluster<E>>,
    free_numbers: Vec<u32>,
    explained: i128,
    moves: u64,
    touched: Touched,
    connection: Connection,
    /// Faces that passes may still look at; 0 where a bound on work has ended a step.
    pub(super) faces_left: usize,
}

/// A cluster.
#[derive(Debug, Clone, Default)]
struct Cluster<E: Functional> {
    faces: Vec<u32>,
    totals: Totals<E>,
}

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

impl<'a, E: Functional> Clusters<'a, E> {
    /// From labels in which every face has one. All clusters count as touched.
    pub fn new(graph: &'a DualGraph<E>, labels: Vec<u32>) -> Self {
        let numbers = labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0);
        let mut sizes = vec![0; numbers];
        labels.iter().for_each(|&label| sizes[label as usize] += 1);
        let with_room = |&size: &usize| Cluster { faces: Vec::with_capacity(size), ..Cluster::default() };
        let mut all: Vec<Cluster<E>> = sizes.iter().map(with_room).collect();
        let mut place_of_face = vec![0; labels.len()];
        for component in &graph.components {
            for face in component.range() {
                let Cluster { faces, totals } = &mut all[labels[face] as usize];
                place_of_face[face] = faces.len() as u32;
                faces.push(face as u32);
                totals.shift = component.energy_shift;
            }
        }
        all.par_iter_mut().with_min_len(CHUNK).for_each(|Cluster { faces, totals }| {
            faces.iter().for_each(|&face| totals.count(graph.face(face as usize), 1));
            totals.refit();
        });
        let explained = all.iter().map(|cluster| cluster.totals.explained()).sum();
        let free_numbers = (0..numbers as u32).rev().filter(|&number| all[number as usize].faces.is_empty()).collect();
        let touched = Touched { list: (0..numbers as u32).collect(), is_listed: vec![true; numbers] };
        let connection = Connection::new(labels.len(), graph.moves);
        let faces_left = PASSES * labels.len();
        Self { graph, labels, place_of_face, all, free_numbers, explained, moves: 0, touched, connection, faces_left }
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
        let number = |cluster: &Cluster<E>| {
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
        self.all[cluster as usize].totals.shift
    }

    /// F, of all clusters.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.explained }
    }

    /// What a cluster explains of F.
    pub fn explained(&self, cluster: u32) -> i128 {
        self.totals(cluster).explained()
    }

    /// F of a cluster.
    pub fn energy_of(&self, cluster: u32) -> i128 {
        self.totals(cluster).energy()
    }

    /// Whether a split of a cluster might gain more than this.
    pub fn may_gain(&self, more_than: i128, cluster: u32) -> bool {
        self.totals(cluster).may_gain(more_than, self.graph, self.faces(cluster))
    }

    /// F of all clusters.
    pub fn total(&self) -> i128 {
        (0..self.numbers() as u32).map(|cluster| self.energy_of(cluster)).sum()
    }

    /// What merging two clusters of one component raises F by.
    pub fn merge_cost(&self, a: u32, b: u32) -> i128 {
        self.totals(a).merge_cost(self.totals(b))
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
        self.all[number as usize].totals.shift = self.shift(cluster);
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
                    self.all[cluster as usize].totals.count(self.graph.face(face as usize), sign);
                }
                self.all[to as usize].totals.shift = self.shift(from);
                self.note_change(from, to, 1);
                changed.extend([from, to]);
            }
        }
        changed.sort_unstable();
        changed.dedup();
        for cluster in changed {
            self.explained += self.all[cluster as usize].totals.refit();
            if self.faces(cluster).is_empty() {
                self.free_numbers.push(cluster);
            }
        }
    }

    /// Moves a face to a neighbouring cluster, if that lowers F, leaves a face behind, and does not cut its cluster in
    /// pieces.
    pub fn move_if_lower(&mut self, face: u32, to: u32) -> bool {
        let from = self.label(face);
        let before = [from, to].map(|cluster| *self.totals(cluster));
        let Some(([without, with], fall)) = Totals::after_move(before, self.graph.face(face as usize)) else {
            return false;
        };
        let Self { graph, labels, connection, .. } = self;
        if fall <= 0 || !connection.stays_without(graph, face, |near| labels[near as usize] == from) {
            return false;
        }
        self.take_from_list(face, from);
        self.push_to_list(face, to);
        self.all[from as usize].totals = without;
        self.all[to as usize].totals = with;
        self.explained += fall;
        self.note_change(from, to, 1);
        true
    }

    /// The proxy and the weight of a cluster.
    pub fn proxy_and_weight(&self, cluster: u32) -> (E::Proxy, u64) {
        let Totals { fit, sums, .. } = self.totals(cluster);
        (fit.0, sums.weight())
    }

    /// Spends work on a pass over the faces of some clusters and at their borders. Returns whether there was enough.
    pub fn spend(&mut self, on: &[u32], at_borders: &[u32]) -> bool {
        let faces: usize = on.iter().map(|&cluster| self.faces(cluster).len()).sum();
        let neighbours: usize = at_borders.iter().map(|&face| self.graph.neighbours_of(face).len()).sum();
        self.faces_left = self.faces_left.saturating_sub(faces + neighbours / NEIGHBOURS);
        self.faces_left > 0
    }

    /// Work so far: steps of searches, and faces that passes looked at.
    pub fn work(&self) -> [u64; 2] {
        [self.connection.steps, (PASSES * self.labels.len() - self.faces_left) as u64]
    }

    /// Whether a bound on work ended a step, or searches of the connection.
    pub fn ending(&self) -> Ending {
        if self.faces_left == 0 || self.connection.is_bounded() { Ending::WorkLimit } else { Ending::Converged }
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
        self.connection.moved(self.graph, face);
    }

    /// Gives faces of a cluster, which are in no list any more, to another one.
    fn hand_over(&mut self, faces: &[u32], from: u32, to: u32) {
        let mut moved = Totals::default();
        for &face in faces {
            self.push_to_list(face, to);
            moved.count(self.graph.face(face as usize), 1);
        }
        for (cluster, sign) in [(from, -1), (to, 1)] {
            self.explained += self.all[cluster as usize].totals.add(&moved, sign);
        }
        self.note_change(from, to, faces.len() as u64);
    }

    fn totals(&self, cluster: u32) -> &Totals<E> {
        &self.all[cluster as usize].totals
    }

    fn note_change(&mut self, from: u32, to: u32, moves: u64) {
        self.touched.add(from);
        self.touched.add(to);
        self.moves += moves;
    }
}
