//! Clusters as lists of their faces, with exact totals: what moves of whole clusters work on.
//!
//! Devices keep labels and sums for moves of single faces, all at once. A merge or a split reads one cluster whole, and
//! few of them pay, so this state is kept on the host. Every cluster is connected, and every change keeps that.

use super::connection::Connection;
use super::lists::Lists;
use super::totals::Totals;
use crate::device::Ending;
use crate::device::dual_edge::from_into;
use crate::energy::{Bounds, Functional, LatticeEnergy, Sums};
use crate::parallel;
use crate::surface::DualGraph;

/// Passes at most, those over some of the clusters counted by their faces, and by the neighbours of those at borders.
const PASSES: usize = 1024;

/// Neighbours that count as a face.
const NEIGHBOURS: usize = 4;

/// Clusters that a thread takes at least.
const CHUNK: usize = 64;

/// A clustering of a graph. Numbers of clusters may be free: [`crate::cluster::numbers::compact`] closes the gaps.
#[derive(Debug, Clone)]
pub struct Clusters<'a, E: Functional> {
    /// The faces.
    pub graph: &'a DualGraph<E>,
    lists: Lists,
    totals: Vec<Totals<E>>,
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

impl<'a, E: Functional> Clusters<'a, E> {
    /// From labels in which every face has one. All clusters count as changed.
    pub fn new(graph: &'a DualGraph<E>, labels: Vec<u32>) -> Self {
        let (faces, lists) = (labels.len(), Lists::new(graph, labels));
        let mut totals = vec![Totals::default(); lists.len()];
        for component in &graph.components {
            lists.labels[component.range()].iter().for_each(|&label| {
                totals[label as usize].shift = component.energy_shift;
            });
        }
        parallel::runs_mut(&mut totals, CHUNK, &|first, totals| {
            for (cluster, totals) in (first as u32..).zip(totals) {
                lists.faces(cluster).iter().for_each(|&face| totals.count(graph.face(face as usize), 1));
                totals.refit();
            }
        });
        let explained = totals.iter().map(Totals::explained).sum();
        let numbers = (0..lists.len() as u32).rev();
        Self {
            graph,
            free_numbers: numbers.filter(|&number| lists.faces(number).is_empty()).collect(),
            explained,
            moves: 0,
            has_changed: vec![true; lists.len()],
            connection: Connection::new(faces, graph.moves),
            faces_left: PASSES * faces,
            lists,
            totals,
        }
    }

    /// All numbers of clusters, the free ones among them.
    pub fn numbers(&self) -> std::ops::Range<u32> {
        0..self.lists.len() as u32
    }

    /// How many clusters there are.
    pub fn count(&self) -> usize {
        self.lists.len() - self.free_numbers.len()
    }

    /// The cluster of each face.
    pub fn labels(&self) -> &[u32] {
        &self.lists.labels
    }

    /// The cluster of a face.
    pub fn label(&self, face: u32) -> u32 {
        self.lists.labels[face as usize]
    }

    /// The faces of a cluster, in no particular order; none of a number that is free.
    pub fn faces(&self, cluster: u32) -> &[u32] {
        self.lists.faces(cluster)
    }

    /// The boundary faces of some clusters, and the faces beside them in others, ascending.
    pub fn around(&self, clusters: &[u32]) -> Vec<u32> {
        self.lists.around(self.graph, clusters)
    }

    /// The totals of a cluster.
    pub fn totals(&self, cluster: u32) -> &Totals<E> {
        &self.totals[cluster as usize]
    }

    /// F, of all clusters.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.explained }
    }

    /// F of all clusters, with the part that no labels change.
    pub fn total(&self) -> i128 {
        self.totals.iter().map(Totals::energy).sum()
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
        let boundary = self.lists.boundary(cluster);
        // most have no more entries than that
        let mut beside = Vec::with_capacity(boundary.len() + 2);
        let mut last = cluster;
        for &face in boundary {
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
            self.totals.push(Totals::default());
            self.has_changed.push(true);
            self.lists.push()
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
                    self.totals[cluster as usize].count(self.graph.face(face as usize), sign);
                }
                self.totals[to as usize].shift = self.totals(from).shift;
                changed.extend([from, to]);
            }
        }
        changed.sort_unstable();
        changed.dedup();
        for cluster in changed {
            self.explained += self.totals[cluster as usize].refit();
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
        let Self { graph, lists: Lists { labels, .. }, connection, .. } = self;
        if fall <= 0 || !connection.stays_without(graph, face, |near| labels[near as usize] == from) {
            return false;
        }
        self.move_face(face, to);
        self.totals[from as usize] = without;
        self.totals[to as usize] = with;
        self.explained += fall;
        true
    }

    /// Moves a face from list to list; totals do not follow.
    fn move_face(&mut self, face: u32, to: u32) {
        [self.label(face), to].into_iter().for_each(|cluster| self.has_changed[cluster as usize] = true);
        self.lists.move_face(self.graph, face, to);
        self.connection.moved(self.graph, face);
        self.moves += 1;
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
        [self.connection.steps, (PASSES * self.labels().len() - self.faces_left) as u64]
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
