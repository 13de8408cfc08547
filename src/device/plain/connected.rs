//! Connected moves as their definition reads ([`mod@crate::cluster::connected::settle`] has it, `docs/uneven.md` the
//! proof): sums, energies and pieces are computed anew for each face that is looked at.
//!
//! It shares one thing with what is compared with it: which detours are seen ([`crate::surface::detour`]). No face
//! moves here because of one alone, so that a detour that is none makes a difference. Searches have no bound here
//! ([`mod@crate::cluster::connected`] has some), so that clusters of thousands of faces may end with other labels.

use super::{Iterated, best_move, explained, sums};
use crate::energy::Functional;
use crate::surface::detour::surely_stays_connected;
use crate::surface::{DualGraph, Moves};

/// A phase of connected moves. Between passes it keeps which clusters changed, and which faces are held.
pub struct ConnectedMoves<'a, E: Functional> {
    graph: &'a DualGraph<E>,
    component_of_cluster: &'a [u32],
    /// One cluster a face, internal order.
    pub labels: Vec<u32>,
    /// Whether a cluster gained or lost a face in the last pass.
    is_changed: Vec<bool>,
    is_held: Vec<bool>,
}

impl<'a, E: Functional> ConnectedMoves<'a, E> {
    /// The beginning of a phase: all clusters count as changed.
    pub fn new(graph: &'a DualGraph<E>, component_of_cluster: &'a [u32], labels: Vec<u32>) -> Self {
        let is_changed = vec![true; component_of_cluster.len()];
        let is_held = vec![false; labels.len()];
        Self { graph, component_of_cluster, labels, is_changed, is_held }
    }

    /// The next pass, in which faces leave that `may_leave`, usually [the method of that name](Self::may_leave). None
    /// when nothing moves, which ends the phase.
    pub fn pass(&mut self, may_leave: impl Fn(&mut Self, u32) -> bool) -> Option<Iterated> {
        let due: Vec<u32> = (0..self.labels.len() as u32).filter(|&face| self.is_due(face)).collect();
        self.is_changed.fill(false);
        let mut moves = 0;
        for face in due {
            let sums = sums(self.graph, self.component_of_cluster.len(), &self.labels);
            let wanted = best_move(self.graph, &sums, &self.labels, face as usize).map(|(_, to)| to);
            if let Some(to) = wanted.filter(|&to| self.falls(face, to))
                && may_leave(self, face)
            {
                self.make(face, to);
                moves += 1;
            }
        }
        let explained = explained(self.graph, self.component_of_cluster, &self.labels);
        (moves > 0).then(|| Iterated { labels: self.labels.clone(), explained, moves })
    }

    /// Whether a face is at the boundary of its cluster and another, one of which changed in the last pass.
    fn is_due(&self, face: u32) -> bool {
        let is_changed = |cluster: u32| self.is_changed[cluster as usize];
        let own = self.labels[face as usize];
        let mut beside = self.graph.neighbours_of(face).iter().map(|&near| self.labels[near as usize]);
        beside.any(|near| near != own && (is_changed(own) || is_changed(near)))
    }

    /// Whether F falls with a face in another cluster.
    fn falls(&self, face: u32, to: u32) -> bool {
        let mut after = self.labels.clone();
        after[face as usize] = to;
        let explained = |labels: &[u32]| explained(self.graph, self.component_of_cluster, labels);
        explained(&after) > explained(&self.labels)
    }

    /// Whether the cluster of a face is in one piece without it, and is seen to be: a held face needs a detour. Holds
    /// the face if not, where [`Moves`] are connected.
    pub fn may_leave(&mut self, face: u32) -> bool {
        if self.is_held[face as usize] && !self.has_detour(face) {
            return false;
        }
        let is_whole = self.is_whole_without(face);
        self.is_held[face as usize] = !is_whole && self.graph.moves == Moves::Connected;
        is_whole
    }

    /// Whether short ways around a face connect its neighbours in its cluster.
    pub fn has_detour(&self, face: u32) -> bool {
        let own = self.labels[face as usize];
        surely_stays_connected(self.graph, face, |near| near != face && self.labels[near as usize] == own)
    }

    /// Whether all other faces of a face's cluster can be reached from one of them through the cluster.
    pub fn is_whole_without(&self, face: u32) -> bool {
        let own = self.labels[face as usize];
        let mut is_left: Vec<bool> = self.labels.iter().map(|&label| label == own).collect();
        is_left[face as usize] = false;
        let mut reached: Vec<u32> =
            is_left.iter().position(|&is_left| is_left).map(|first| first as u32).into_iter().collect();
        while let Some(at) = reached.pop() {
            is_left[at as usize] = false;
            reached.extend(self.graph.neighbours_of(at).iter().filter(|&&near| is_left[near as usize]));
        }
        !is_left.contains(&true)
    }

    /// Moves a face. Neither it nor a face beside it is held any longer.
    fn make(&mut self, face: u32, to: u32) {
        for cluster in [self.labels[face as usize], to] {
            self.is_changed[cluster as usize] = true;
        }
        self.labels[face as usize] = to;
        for &near in self.graph.neighbours_of(face).iter().chain([&face]) {
            self.is_held[near as usize] = false;
        }
    }
}
