//! The plain device: every step as its definition in [`crate::cluster`] reads. The cpu and the gpu device are compared
//! with it.
//!
//! It is sequential, recomputes everything from the labels in every iteration, and adds in 128-bit integers. Nothing is
//! cached, skipped or approximated. With other devices it shares the arithmetic of [`crate::energy`] and the order of
//! dual edges, and no state. An iteration costs at least a pass over the mesh, so it is for meshes of some thousand
//! faces. A new step or a new energy is written here first.
//!
//! The functions are pure: labels in, labels out. [`PlainDevice`] offers them as [`super::Steps`] and
//! [`super::MergeSteps`], so that every driver of [`crate::cluster`] runs on them unchanged. [`ConnectedMoves`] are no
//! step: they are made on the host, whatever the device.

mod connected;
mod device;

use std::cmp::Reverse;

pub use self::connected::ConnectedMoves;
pub use self::device::{PlainDevice, open};

use super::{FLOOD_FROM, FREE};
use crate::energy::{Functional, Side, WideSums};
use crate::surface::DualGraph;

/// The state after an iteration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Iterated {
    /// One cluster a face, internal order.
    pub labels: Vec<u32>,
    /// What the proxies explain of the energy, see [`crate::energy::LatticeEnergy`].
    pub explained: i128,
    /// Faces that changed their cluster, each once for every pass in which it did.
    pub moves: u64,
}

/// Labels after growth from the labelled faces ([`super::Steps::grow`]).
pub fn grow<E: Functional>(graph: &DualGraph<E>, labels: &[u32]) -> Vec<u32> {
    let mut labels = labels.to_vec();
    loop {
        let before = labels.clone();
        for face in 0..labels.len() as u32 {
            if before[face as usize] == FREE {
                let reach = graph.neighbours_of(face).iter().map(|&near| before[near as usize]);
                labels[face as usize] = reach.min().unwrap_or(FREE);
            }
        }
        if labels == before {
            return labels;
        }
    }
}

/// The sums of each cluster. Free faces count for none.
pub fn sums<E: Functional>(graph: &DualGraph<E>, clusters: usize, labels: &[u32]) -> Vec<E::WideSums> {
    let mut all = vec![E::WideSums::default(); clusters];
    for (face, &label) in labels.iter().enumerate().filter(|(_, label)| **label != FREE) {
        all[label as usize].add_face(graph.face(face));
    }
    all
}

/// What the proxies explain, summed over the clusters that have faces, see [`crate::energy::LatticeEnergy`].
pub fn explained<E: Functional>(graph: &DualGraph<E>, component_of_cluster: &[u32], labels: &[u32]) -> i128 {
    let sums = sums(graph, component_of_cluster.len(), labels);
    sums.iter()
        .zip(component_of_cluster)
        .filter(|(sums, _)| sums.faces() > 0)
        .map(|(sums, &component)| sums.explained() << graph.components[component as usize].energy_shift)
        .sum()
}

/// Faces with another label.
fn moves(before: &[u32], after: &[u32]) -> u64 {
    before.iter().zip(after).filter(|(before, after)| before != after).count() as u64
}

/// The cost of a face in each cluster that has faces.
fn costs<'a, E: Functional>(graph: &'a DualGraph<E>, sums: &'a [E::WideSums]) -> impl Fn(usize, u32) -> i128 + 'a {
    move |face, cluster| sums[cluster as usize].cost(graph.face(face))
}

/// One boundary iteration ([`crate::cluster::flat`]), the `number`-th of its phase from 1; None when nothing moves.
pub fn iterate<E: Functional>(
    graph: &DualGraph<E>,
    component_of_cluster: &[u32],
    labels: &[u32],
    number: u32,
) -> Option<Iterated> {
    let proxies = sums(graph, component_of_cluster.len(), labels);
    let mut after = pass(graph, &proxies, labels);
    let mut moves = moves(labels, &after);
    let mut is_going_on = number >= FLOOD_FROM;
    while is_going_on {
        let next = pass(graph, &proxies, &after);
        is_going_on = next != after;
        moves += self::moves(&after, &next);
        after = next;
    }
    (moves > 0).then(|| Iterated { explained: explained(graph, component_of_cluster, &after), labels: after, moves })
}

/// The labels after one pass of a boundary iteration, with the proxies of these sums.
fn pass<E: Functional>(graph: &DualGraph<E>, proxies: &[E::WideSums], labels: &[u32]) -> Vec<u32> {
    let cost = costs(graph, proxies);
    // 1. the nearest cluster beside each face, if it is nearer than the face's own
    let wanted = |face: usize| {
        let own = labels[face];
        let near = graph.neighbours_of(face as u32).iter().map(|&near| labels[near as usize]);
        let (best, to) = near.filter(|&label| label != own).map(|label| (cost(face, label), label)).min()?;
        (best < cost(face, own)).then_some(to)
    };
    let wanted: Vec<Option<u32>> = (0..labels.len()).map(wanted).collect();
    // 2. the last face: of a cluster that all faces want to leave, the first one stays
    let mut faces = vec![0; proxies.len()];
    let mut leaving: Vec<Vec<usize>> = vec![Vec::new(); proxies.len()];
    for (face, &own) in labels.iter().enumerate() {
        faces[own as usize] += 1;
        leaving[own as usize].extend(wanted[face].map(|_| face));
    }
    let stays = |face: usize| {
        let own = labels[face] as usize;
        leaving[own].len() == faces[own] && leaving[own][0] == face
    };
    // 3. all others move
    (0..labels.len()).map(|face| wanted[face].filter(|_| !stays(face)).unwrap_or(labels[face])).collect()
}

/// The largest gain of a face in a cluster beside it, and that cluster, the smaller number of equal ones; None if the
/// gain is not positive or the face is alone in its own.
fn best_move<E: Functional>(
    graph: &DualGraph<E>,
    sums: &[E::WideSums],
    labels: &[u32],
    face: usize,
) -> Option<(i64, u32)> {
    let cost = costs(graph, sums);
    let side = |cluster: u32| Side { cost: cost(face, cluster) as u64, weight: sums[cluster as usize].weight() };
    let own = labels[face];
    if sums[own as usize].faces() == 1 {
        return None;
    }
    let others = graph.neighbours_of(face as u32).iter().map(|&near| labels[near as usize]).filter(|&to| to != own);
    let gains = others.map(|to| (E::gain(graph.weights[face], side(own), side(to)), Reverse(to)));
    gains.max().filter(|&(gain, _)| gain > 0).map(|(gain, Reverse(to))| (gain, to))
}

/// A refinement phase ([`crate::cluster::refinement`]). What it keeps between iterations is which faces were refused.
pub struct Refinement<'a, E: Functional> {
    graph: &'a DualGraph<E>,
    component_of_cluster: &'a [u32],
    /// One cluster a face, internal order.
    pub labels: Vec<u32>,
    refused: Vec<bool>,
}

impl<'a, E: Functional> Refinement<'a, E> {
    /// The beginning of a phase.
    pub fn new(graph: &'a DualGraph<E>, component_of_cluster: &'a [u32], labels: Vec<u32>) -> Self {
        let refused = vec![false; labels.len()];
        Self { graph, component_of_cluster, labels, refused }
    }

    /// The next iteration in which something moves; None when there are no bids.
    pub fn iterate(&mut self) -> Option<Iterated> {
        loop {
            let bids = self.bids();
            if bids.iter().all(Option::is_none) {
                return None;
            }
            let before = self.labels.clone();
            for (face, to) in winners(&before, &bids, self.component_of_cluster.len()) {
                let joins = |f: &usize| before[*f] == before[face] && bids[*f].is_some_and(|(_, t)| t == to);
                let joining: Vec<usize> = (0..before.len()).filter(joins).collect();
                if !self.try_moving(&joining, to) && !self.try_moving(&[face], to) {
                    self.refused[face] = true;
                }
            }
            let moves = moves(&before, &self.labels);
            if moves > 0 {
                self.readmit(&before);
                let explained = explained(self.graph, self.component_of_cluster, &self.labels);
                return Some(Iterated { labels: self.labels.clone(), explained, moves });
            }
        }
    }

    /// The packed bid of each face, and the cluster that it is for.
    fn bids(&self) -> Vec<Option<(u32, u32)>> {
        let sums = sums(self.graph, self.component_of_cluster.len(), &self.labels);
        let bid_of = |face: usize| {
            let (gain, to) = best_move(self.graph, &sums, &self.labels, face).filter(|_| !self.refused[face])?;
            Some((E::bid(gain, self.graph.weights[face]), to))
        };
        (0..self.labels.len()).map(bid_of).collect()
    }

    /// Moves faces of one cluster to another if that lowers the energy and leaves a face behind.
    fn try_moving(&mut self, faces: &[usize], to: u32) -> bool {
        let from = self.labels[faces[0]];
        let mut after = self.labels.clone();
        faces.iter().for_each(|&face| after[face] = to);
        let explained = |labels: &[u32]| explained(self.graph, self.component_of_cluster, labels);
        let is_allowed = after.contains(&from) && explained(&after) > explained(&self.labels);
        if is_allowed {
            self.labels = after;
        }
        is_allowed
    }

    /// Lets refused faces bid again whose own cluster, or one beside them, gained or lost a face.
    fn readmit(&mut self, before: &[u32]) {
        let mut is_changed = vec![false; self.component_of_cluster.len()];
        for (&old, &new) in before.iter().zip(&self.labels).filter(|(old, new)| old != new) {
            is_changed[old as usize] = true;
            is_changed[new as usize] = true;
        }
        for face in 0..before.len() {
            let near = self.graph.neighbours_of(face as u32).iter().map(|&near| self.labels[near as usize]);
            if near.chain([self.labels[face]]).any(|label| is_changed[label as usize]) {
                self.refused[face] = false;
            }
        }
    }
}

/// The faces whose bid is the best at both its clusters, and where they go.
fn winners(labels: &[u32], bids: &[Option<(u32, u32)>], clusters: usize) -> Vec<(usize, u32)> {
    let mut best: Vec<Option<(u32, Reverse<usize>)>> = vec![None; clusters];
    let open = || bids.iter().enumerate().filter_map(|(face, bid)| bid.map(|(bid, to)| (face, bid, to)));
    for (face, bid, to) in open() {
        for cluster in [labels[face], to] {
            best[cluster as usize] = best[cluster as usize].max(Some((bid, Reverse(face))));
        }
    }
    let wins = |face: usize, cluster: u32| best[cluster as usize].is_some_and(|(_, Reverse(winner))| winner == face);
    open().filter(|&(face, _, to)| wins(face, labels[face]) && wins(face, to)).map(|(face, _, to)| (face, to)).collect()
}
