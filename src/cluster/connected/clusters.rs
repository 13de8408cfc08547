//! Clusters as lists of their faces, with exact totals: what moves of whole clusters work on.
//!
//! Devices keep labels and sums for moves of single faces, all at once. A merge or a split reads one cluster whole, and
//! few of them pay, so this state is kept on the host. Every cluster is connected, and every change keeps that.

use rayon::prelude::*;

use super::connection::Connection;
use super::totals::Totals;
use crate::device::Ending;
use crate::device::dual_edge::from_into;
use crate::energy::{Bounds, Functional, LatticeEnergy, Sums};
use crate::surface::DualGraph;

/// Passes at most, those over some of the clusters counted by their faces, and by the neighbours of those at borders.
const PASSES: usize = 1024;

/// Neighbours that count as a face.
const NEIGHBOURS: usize = 4;

/// Clusters of a chunk.
const CHUNK: usize = 64;

/// A clustering of a graph. Numbers of clusters may be free: [`crate::cluster::numbers::compact`] closes the gaps.
#[derive(Debug, Clone)]
pub struct Clusters<'a, E: Functional> {
    /// The faces.
    pub graph: &'a DualGraph<E>,
    labels: Vec<u32>,
    /// Where each face stands in the list of its cluster.
    place_of_face: Vec<u32>,
    all: Vec<Cluster<E>>,
    free_numbers: Vec<u32>,
    /// Of F; the rest of it is the same for all labels.
    explained: i128,
    moves: u64,
    /// Whether each cluster has gained or lost a face.
    has_changed: Vec<bool>,
    connection: Connection,
    /// Faces that passes may still look at; 0 where a bound on work has ended a step.
    pub faces_left: usize,
}

/// A cluster.
#[derive(Debug, Clone, Default)]
struct Cluster<E: Functional> {
    faces: Vec<u32>,
    totals: Totals<E>,
}

impl<'a, E: Functional> Clusters<'a, E> {
    /// From labels in which every face has one. All clusters count as changed.
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
        let connection = Connection::new(labels.len(), graph.moves);
        Self {
            graph,
            place_of_face,
            all,
            free_numbers,
            explained,
            moves: 0,
            has_changed: vec![true; numbers],
            connection,
            faces_left: PASSES * labels.len(),
            labels,
        }
    }

    /// All numbers of clusters, the free ones among them.
    pub fn numbers(&self) -> std::ops::Range<u32> {
        0..self.all.len() as u32
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

    /// The faces of a cluster, in no particular order; none of a number that is free.
    pub fn faces(&self, cluster: u32) -> &[u32] {
        &self.all[cluster as usize].faces
    }

    /// How many faces some clusters have together.
    pub fn faces_of(&self, clusters: &[u32]) -> usize {
        clusters.iter().map(|&cluster| self.faces(cluster).len()).sum()
    }

    /// The totals of a cluster.
    pub fn totals(&self, cluster: u32) -> &Totals<E> {
        &self.all[cluster as usize].totals
    }

    /// F, of all clusters.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.explained }
    }

    /// F of all clusters, with the part that no labels change.
    pub fn total(&self) -> i128 {
        self.all.iter().map(|cluster| cluster.totals.energy()).sum()
    }

    /// Whether a split of a cluster might gain more than this.
    pub fn may_gain(&self, more_than: i128, cluster: u32) -> bool {
        let totals = self.totals(cluster);
        let most = || {
            let mut bounds = E::SplitBounds::default();
            self.faces(cluster).iter().for_each(|&face| bounds.add(self.graph.face(face as usize)));
            (bounds.most_gain() as i128).saturating_mul(1 << totals.shift)
        };
        totals.energy() > more_than && most() >= more_than
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
            self.has_changed.push(true);
            self.all.len() as u32 - 1
        })
    }

    /// Merges two neighbouring clusters, in the order of [`from_into`]. The number of the first gets free. Returns the
    /// other.
    pub fn merge(&mut self, a: u32, b: u32) -> u32 {
        let pair @ (low, high) = (a.min(b), a.max(b));
        let (from, into) = from_into(pair, [low, high].map(|cluster| self.faces(cluster).len() as u32));
        let faces = self.faces(from).to_vec();
        self.relabel(faces.into_iter().map(|face| (face, into)));
        into
    }

    /// Makes a cluster of some faces of a cluster, but not all, and returns its number.
    pub fn split(&mut self, leaving: &[u32]) -> u32 {
        let number = self.free_number();
        self.relabel(leaving.iter().map(|&face| (face, number)));
        number
    }

    /// Gives faces to other clusters of their component: (face, cluster). A cluster that loses all faces gets free; all
    /// others must be connected afterwards. A number from [`free_number`](Self::free_number) is a new cluster.
    pub fn relabel(&mut self, moves: impl Iterator<Item = (u32, u32)>) {
        let mut changed = Vec::new();
        for (face, to) in moves {
            let from = self.label(face);
            if from != to {
                self.move_face(face, to);
                for (cluster, sign) in [(from, -1), (to, 1)] {
                    self.all[cluster as usize].totals.count(self.graph.face(face as usize), sign);
                }
                self.all[to as usize].totals.shift = self.totals(from).shift;
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

    /// By how much F falls, exactly, when a face goes to another cluster of its component; none when its own would be
    /// left empty.
    pub fn fall(&self, face: u32, to: u32) -> Option<i128> {
        self.after_move(face, to).map(|(_, fall)| fall)
    }

    /// The totals of both clusters after a move, and what F falls by.
    fn after_move(&self, face: u32, to: u32) -> Option<([Totals<E>; 2], i128)> {
        let [mut from, mut to] = [self.label(face), to].map(|cluster| *self.totals(cluster));
        from.count(self.graph.face(face as usize), -1);
        to.count(self.graph.face(face as usize), 1);
        let fall = from.refit() + to.refit();
        (from.sums.faces() > 0).then_some(([from, to], fall))
    }

    /// Moves a face to a neighbouring cluster, if that lowers F, leaves a face behind, and does not cut its cluster in
    /// pieces.
    pub fn move_if_lower(&mut self, face: u32, to: u32) -> bool {
        let from = self.label(face);
        let Some(([without, with], fall)) = self.after_move(face, to) else {
            return false;
        };
        let Self { graph, labels, connection, .. } = self;
        if fall <= 0 || !connection.stays_without(graph, face, |near| labels[near as usize] == from) {
            return false;
        }
        self.move_face(face, to);
        self.all[from as usize].totals = without;
        self.all[to as usize].totals = with;
        self.explained += fall;
        true
    }

    /// Moves a face from list to list, where the last face gets its place; totals do not follow.
    fn move_face(&mut self, face: u32, to: u32) {
        let from = std::mem::replace(&mut self.labels[face as usize], to);
        let place = self.place_of_face[face as usize];
        let left = &mut self.all[from as usize].faces;
        left.swap_remove(place as usize);
        if let Some(&last) = left.get(place as usize) {
            self.place_of_face[last as usize] = place;
        }
        let faces = &mut self.all[to as usize].faces;
        self.place_of_face[face as usize] = faces.len() as u32;
        faces.push(face);
        self.connection.moved(self.graph, face);
        [from, to].into_iter().for_each(|cluster| self.has_changed[cluster as usize] = true);
        self.moves += 1;
    }

    /// Spends work on a pass over the faces of some clusters and at their borders. Returns whether there was enough.
    pub fn spend(&mut self, on: &[u32], at_borders: &[u32]) -> bool {
        let faces = self.faces_of(on);
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

    /// Takes, for each cluster, whether it gained or lost a face since the last call.
    pub fn take_changes(&mut self) -> Vec<bool> {
        let none = vec![false; self.has_changed.len()];
        std::mem::replace(&mut self.has_changed, none)
    }

    /// Takes the number of faces that changed their cluster since the last call.
    pub fn take_moves(&mut self) -> u64 {
        std::mem::take(&mut self.moves)
    }
}
