//! Clusters whose boundary faces are listed: the state in which faces move.

use std::sync::atomic::AtomicU32;

use super::active_faces::ActiveFaces;
use super::best_edge::{self, queue::Queue};
use super::boundary::BoundaryPhase;
use super::boundary_faces::BoundaryFaces;
use super::change_log::Cursor;
use super::clusters::Clusters;
use super::grow::grow;
use super::labels::Labels;
use super::pieces;
use super::refine::RefinementPhase;
use super::{Move, Partition};
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, FLOOD_FROM, FREE};
use crate::energy::Functional;
use crate::error::Result;
use crate::prefetch::{Ahead, with_lookahead};
use crate::surface::DualGraph;
use crate::surface::detour::surely_stays_connected;

/// A partition, and what phases keep between iterations.
#[derive(Debug)]
pub struct Listed<'a, E: Functional> {
    pub partition: Partition<'a, E>,
    /// Created by the first boundary phase.
    boundary_phase: Option<BoundaryPhase>,
    /// Created by the first refinement.
    refinement: Option<RefinementPhase>,
    /// The last iteration of the last boundary phase.
    boundary_iteration: u32,
    /// Whether the next phase goes on with the last one.
    pub is_resumed: bool,
    /// Created by the first search for the cheapest dual edge.
    queue: Option<Queue>,
    /// Clusters that may have faces, ascending.
    living: Vec<u32>,
    /// Scratch memory of walks, empty before the first.
    places: Vec<AtomicU32>,
    /// The faces that moved since the last merge, with the cluster they left; None before the first merge.
    moved_since_merge: Option<Vec<(u32, u32)>>,
}

impl<'a, E: Functional> Listed<'a, E> {
    /// Lists the boundary faces of clusters that are in step with `labels`. All faces are labelled. `has_merged`:
    /// whether clusters merged before.
    pub fn new(graph: &'a DualGraph<E>, mut labels: Labels, clusters: Clusters<E>, has_merged: bool) -> Self {
        let boundary = BoundaryFaces::collect(graph, &mut labels, clusters.len());
        Self {
            living: (0..clusters.len() as u32).collect(),
            partition: Partition { graph, labels, clusters, boundary },
            boundary_phase: None,
            refinement: None,
            boundary_iteration: 0,
            is_resumed: false,
            queue: None,
            places: Vec::new(),
            moved_since_merge: has_merged.then(Vec::new),
        }
    }

    /// Begins a boundary phase. A resumed one counts its iterations on.
    pub fn begin_boundary(&mut self) {
        if !std::mem::take(&mut self.is_resumed) {
            self.boundary_iteration = 0;
        }
    }

    /// Makes the next boundary iteration. Returns how many moves that were; None when the phase has converged. Once
    /// cancelled, a flood makes no further pass.
    pub fn boundary_iteration(&mut self, cancel: &Cancel) -> Option<u64> {
        let Self { partition, boundary_phase, .. } = self;
        let changed = partition.clusters.change_log.take(Cursor::Boundary);
        let mut moves = boundary_phase.get_or_insert_with(|| BoundaryPhase::new(partition)).moves(partition, &changed);
        self.boundary_iteration = self.boundary_iteration.saturating_add(1);
        let mut made = 0;
        while !moves.is_empty() {
            made += moves.len() as u64;
            self.move_faces(&moves);
            let flooding = self.boundary_phase.as_mut().filter(|_| self.boundary_iteration >= FLOOD_FROM);
            moves = match flooding {
                // no proxy has changed
                Some(phase) if !cancel.is_cancelled() => phase.moves(&mut self.partition, &[]),
                _ => break,
            };
        }
        self.partition.clusters.refit();
        (made > 0).then_some(made)
    }

    /// Begins a refinement phase. A resumed one goes on with the last: refused faces stay refused.
    pub fn begin_refinement(&mut self) {
        if !std::mem::take(&mut self.is_resumed) {
            self.refinement.iter_mut().for_each(RefinementPhase::begin);
        }
    }

    /// Makes the next iteration of refinement. Returns how many moves that were, maybe none; None when there are no
    /// bids.
    pub fn refinement_iteration(&mut self) -> Option<u64> {
        let Self { partition, refinement, .. } = self;
        let moves = refinement.get_or_insert_with(|| RefinementPhase::new(partition)).moves(partition)?;
        self.apply(&moves);
        Some(moves.len() as u64)
    }

    /// Brings all bids up to date.
    #[cfg(test)]
    pub fn renew_bids(&mut self) -> &super::bids::Bids {
        let Self { partition, refinement, .. } = self;
        refinement.get_or_insert_with(|| RefinementPhase::new(partition)).renew_bids(partition)
    }

    /// Moves faces and fits the proxies.
    pub fn apply(&mut self, moves: &[Move]) {
        self.move_faces(moves);
        self.partition.clusters.refit();
    }

    /// Moves faces, one after the other, with the proxies held.
    fn move_faces(&mut self, moves: &[Move]) {
        let outgrows_caches = self.partition.graph.outgrows_caches();
        for (&Move { face, from, to }, ahead) in with_lookahead(moves) {
            if outgrows_caches {
                self.prefetch(ahead);
            }
            let Partition { graph, labels, clusters, boundary } = &mut self.partition;
            labels.set(face, to);
            clusters.transfer(graph, face, from, to);
            if clusters.change_log.is_connected(from)
                && !surely_stays_connected(graph, face, |near| labels.of(near) == from)
            {
                clusters.change_log.may_be_in_pieces(from);
            }
            if graph.neighbours_of(face).iter().all(|&near| labels.of(near) != to) {
                clusters.change_log.may_be_in_pieces(to);
            }
            boundary.moved(graph, labels, face);
            active_faces(&mut self.boundary_phase, &mut self.refinement)
                .for_each(|active| active.moved(graph, labels, face));
        }
        if let Some(moved) = &mut self.moved_since_merge {
            moved.extend(moves.iter().map(|&Move { face, from, .. }| (face, from)));
        }
    }

    /// Requests what later moves read.
    fn prefetch(&self, ahead: Ahead<'_, Move>) {
        let Partition { graph, labels, clusters, boundary } = &self.partition;
        if let Some(later) = ahead.stage(3) {
            graph.prefetch(later.face);
            clusters.prefetch(later.from);
            clusters.prefetch(later.to);
        }
        if let Some(later) = ahead.stage(2) {
            graph.prefetch_neighbours(later.face);
        }
        if let Some(later) = ahead.stage(1) {
            for &near in graph.neighbours_of(later.face) {
                graph.prefetch(near);
                labels.prefetch(near);
                boundary.prefetch(near);
                self.boundary_phase.iter().for_each(|phase| phase.active.prefetch(near));
                self.refinement.iter().for_each(|phase| phase.active.prefetch(near));
            }
        }
    }

    /// The faces outside the largest piece of each cluster, sorted.
    pub fn cut_off_faces(&mut self) -> Vec<u32> {
        let changed = self.partition.clusters.change_log.take(Cursor::Pieces);
        self.places.resize_with(self.partition.graph.faces(), AtomicU32::default);
        pieces::cut_off(&self.partition, &changed, &self.places)
    }

    /// Frees faces and grows the clusters over them.
    pub fn regrow(&mut self, faces: &[u32], cancel: &Cancel) -> Result<()> {
        let Partition { graph, labels, .. } = &mut self.partition;
        let from: Vec<u32> = faces.iter().map(|&face| labels.refresh(face)).collect();
        faces.iter().for_each(|&face| labels.set(face, FREE));
        grow(graph, labels, faces, cancel)?;
        let moves: Vec<Move> = faces
            .iter()
            .zip(from)
            .map(|(&face, from)| Move { face, from, to: labels.of(face) })
            .filter(|moved| moved.to != moved.from)
            .collect();
        // `apply` expects the labels before the moves
        moves.iter().for_each(|moved| labels.set(moved.face, moved.from));
        self.apply(&moves);
        Ok(())
    }

    /// Moves faces to the clusters that these labels give them.
    pub fn relabel(&mut self, labels: &[u32]) {
        let moved = (0..).zip(self.partition.labels.all()).zip(labels).filter(|&((_, from), to)| from != to);
        let moves: Vec<Move> = moved.map(|((face, &from), &to)| Move { face, from, to }).collect();
        self.apply(&moves);
    }

    /// Merges the first cluster of each pair into the second.
    pub fn merge(&mut self, pairs: &[(u32, u32)]) {
        let Self { partition: Partition { graph, labels, clusters, boundary }, boundary_phase, refinement, .. } = self;
        labels.merge(clusters.len(), pairs);
        labels.renew_after(pairs.len());
        clusters.merge(pairs);
        for &(from, into) in pairs {
            boundary.merged(graph, labels, into, from, |labels, face| {
                active_faces(boundary_phase, refinement).for_each(|active| active.moved(graph, labels, face));
            });
        }
        self.moved_since_merge = Some(Vec::new());
    }

    /// The faces that are in another cluster than after the last merge, sorted: face, old cluster, new cluster.
    pub fn moves_since_merge(&mut self) -> Vec<(u32, u32, u32)> {
        let mut moved = self.moved_since_merge.take().unwrap_or_default();
        // the sort is stable: the first entry of a face has the cluster that it left first
        moved.sort_by_key(|&(face, _)| face);
        moved.dedup_by_key(|&mut (face, _)| face);
        let moved = moved.into_iter().map(|(face, from)| (face, from, self.partition.labels.of(face)));
        moved.filter(|&(_, from, to)| from != to).collect()
    }

    /// The neighbour that each cluster would best merge with, in the order of the clusters.
    pub fn choices(&mut self, ties: Ties) -> Vec<(u32, u32)> {
        best_edge::boundary::choices(&mut self.partition, &mut self.living, ties)
    }

    /// The cheapest dual edge of all.
    pub fn cheapest_edge(&mut self, ties: Ties) -> Option<Rank<u128>> {
        let Self { partition, queue, .. } = self;
        queue.get_or_insert_with(|| Queue::new(partition.clusters.len(), ties)).cheapest(partition)
    }
}

/// The active faces of both phases.
fn active_faces<'a>(
    boundary: &'a mut Option<BoundaryPhase>,
    refinement: &'a mut Option<RefinementPhase>,
) -> impl Iterator<Item = &'a mut ActiveFaces> {
    let boundary = boundary.iter_mut().map(|phase| &mut phase.active);
    boundary.chain(refinement.iter_mut().map(|phase| &mut phase.active))
}
