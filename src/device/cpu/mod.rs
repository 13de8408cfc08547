//! The cpu device: the steps of an algorithm on the threads of this machine.
//!
//! It looks only at faces whose decision can have changed (`watch`), which makes the labels of every iteration equal
//! to those of a plain sweep. Faces decide in parallel; those that move do so in one thread, because they are few. Both lie all
//! over the mesh: in large ones most of the time goes to waiting for memory, so there it is asked for ahead. While each cluster still
//! is what merges made of faces that were one each, the contracted graph of the clusters stands for the faces.

mod boundary;
mod changes;
mod clusters;
mod contraction;
mod dual_edges;
mod frontier;
mod grow;
mod labels;
mod pieces;
mod refine;
mod sieve;
mod watch;

use std::sync::atomic::AtomicU32;

use rayon::current_num_threads;

use super::{Cancel, Device, DualEdge, Ending, FREE, LatticeEnergy, MergeSteps, Step, Steps};
use crate::cluster::dual_edge::{Rank, Ties};
use crate::cluster::sums::ClusterSums;
use crate::error::Result;
use crate::prefetch::{Ahead, with_lookahead};
use crate::report::{DeviceInfo, DeviceKind};
use crate::surface::DualGraph;
use boundary::Leaving;
use changes::Reader;
use clusters::Clusters;
use contraction::Contraction;
use frontier::Frontier;
use grow::Growth;
use labels::Labels;
use pieces::Pieces;
use refine::Bids;
use watch::Watch;

/// The threads of this machine, through rayon's pool: the one that it is called in, else the global one.
#[derive(Debug)]
pub struct CpuDevice {
    info: DeviceInfo,
}

impl CpuDevice {
    /// The device; there is always one.
    pub fn new() -> Self {
        let info = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: std::env::consts::ARCH.to_owned(),
            backend: "rayon".to_owned(),
            driver: format!("{} threads", current_num_threads()),
        };
        Self { info }
    }
}

impl Default for CpuDevice {
    fn default() -> Self {
        Self::new()
    }
}

impl Device for CpuDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn another(&self) -> Option<Box<dyn Device>> {
        Some(Box::new(Self { info: self.info.clone() }))
    }

    fn open<'a>(&'a mut self, graph: &'a DualGraph, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        Ok(open(graph, component_of_cluster))
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps + 'a>> {
        Ok(Box::new(CpuSteps::new(graph, component_of_cluster)))
    }
}

/// The steps on a surface: what [`CpuDevice`] opens.
pub fn open<'a>(graph: &'a DualGraph, component_of_cluster: &'a [u32]) -> Box<dyn Steps + 'a> {
    Box::new(CpuSteps::new(graph, component_of_cluster))
}

/// Faces a thread takes at a time.
const CHUNK: usize = 1024;

/// A face that moves from one cluster to another.
#[derive(Debug, Clone, Copy)]
struct Move {
    face: u32,
    from: u32,
    to: u32,
}

/// State of one clustering.
struct CpuSteps<'a> {
    graph: &'a DualGraph,
    labels: Labels,
    /// The sums of `labels`, once they are summed up.
    clusters: Clusters,
    /// Whether `clusters` are in step with `labels`; not after they were changed from outside.
    are_summed: bool,
    /// Whether each face was a cluster when the labels were set; clusters may have merged since.
    began_as_faces: bool,
    /// The graph of clusters that began as faces and are summed up, from the first search for dual edges until there is a
    /// frontier.
    contraction: Option<Contraction>,
    /// The frontier of `labels`, once it was needed.
    frontier: Option<Frontier>,
    growth: Growth,
    leaving: Leaving,
    /// Which faces are due in the boundary phase, and in refinement; once there was such a phase.
    boundary_watch: Option<Watch>,
    refinement_watch: Option<Watch>,
    bids: Bids,
    /// For walks through clusters, once there was one: where each face comes in the walk that last came to it.
    places: Vec<AtomicU32>,
    /// Clusters that may have faces, ascending.
    living: Vec<u32>,
    /// What each living cluster last chose to merge with, or [`FREE`].
    choices: Vec<u32>,
    /// Once the cheapest dual edge was asked for.
    queue: Option<dual_edges::Queue>,
    /// Once clusters merged: the faces that moved since the last merge, with the cluster they left.
    left: Option<Vec<(u32, u32)>>,
    /// Whether the next phase goes on with the last one.
    resumed: bool,
}

impl<'a> CpuSteps<'a> {
    /// All faces free.
    fn new(graph: &'a DualGraph, component_of_cluster: &[u32]) -> Self {
        let clusters = component_of_cluster.len();
        Self {
            graph,
            labels: Labels::new(graph.faces()),
            clusters: Clusters::new(graph, component_of_cluster),
            are_summed: false,
            began_as_faces: false,
            contraction: None,
            frontier: None,
            growth: Growth::default(),
            leaving: Leaving::new(clusters),
            boundary_watch: None,
            refinement_watch: None,
            bids: Bids::default(),
            places: Vec::new(),
            living: (0..clusters as u32).collect(),
            choices: Vec::new(),
            queue: None,
            left: None,
            resumed: false,
        }
    }

    /// Forgets what was known of labels that are changed from outside.
    fn forget(&mut self) {
        self.are_summed = false;
        self.began_as_faces = false;
        self.contraction = None;
        self.frontier = None;
    }

    /// Brings the sums in step with labels that were changed from outside.
    fn sum(&mut self) {
        if !self.are_summed {
            self.clusters.gather(self.graph, self.labels.all());
            self.bids = Bids::default();
            self.boundary_watch = None;
            self.refinement_watch = None;
            self.are_summed = true;
        }
    }

    /// Brings sums and frontier in step with the labels.
    fn gather(&mut self) {
        self.sum();
        if self.frontier.is_none() {
            self.contraction = None;
            self.frontier = Some(Frontier::collect(self.graph, &mut self.labels, self.clusters.len()));
        }
    }

    /// The graph of clusters, as long as it says all.
    fn contraction(&mut self, ties: Ties) -> Option<(&mut Contraction, &Clusters)> {
        if !self.began_as_faces || self.frontier.is_some() {
            return None;
        }
        self.sum();
        let contraction = self.contraction.get_or_insert_with(|| Contraction::new(self.graph, ties));
        (contraction.ties() == ties).then_some((contraction, &self.clusters))
    }

    /// Lets faces go where they want.
    fn apply(&mut self, moves: &[Move]) {
        let Some(mut frontier) = self.frontier.take() else { return };
        let outgrows_caches = self.graph.outgrows_caches();
        for (&Move { face, from, to }, ahead) in with_lookahead(moves) {
            if outgrows_caches {
                self.prefetch(&frontier, ahead);
            }
            self.labels.set(face, to);
            self.clusters.transfer(self.graph, face, from, to);
            frontier.moved(self.graph, &mut self.labels, face);
            for watch in [&mut self.boundary_watch, &mut self.refinement_watch].into_iter().flatten() {
                watch.moved(self.graph, &self.labels, face);
            }
        }
        self.frontier = Some(frontier);
        self.clusters.refit();
        if let Some(left) = &mut self.left {
            left.extend(moves.iter().map(|&Move { face, from, .. }| (face, from)));
        }
    }

    /// Prefetches what later moves need.
    fn prefetch(&self, frontier: &Frontier, ahead: Ahead<'_, Move>) {
        if let Some(later) = ahead.stage(3) {
            self.graph.prefetch(later.face);
            self.clusters.prefetch(later.from);
            self.clusters.prefetch(later.to);
        }
        if let Some(later) = ahead.stage(2) {
            self.graph.prefetch_neighbours(later.face);
        }
        if let Some(later) = ahead.stage(1) {
            for &near in self.graph.neighbours_of(later.face) {
                self.graph.prefetch(near);
                self.labels.prefetch(near);
                frontier.prefetch(near);
                for watch in [&self.boundary_watch, &self.refinement_watch].into_iter().flatten() {
                    watch.prefetch(near);
                }
            }
        }
    }

    /// Carries out iterations until one has nothing left to do (None), or the limit is reached.
    fn optimise(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
        mut next_moves: impl FnMut(&mut Self) -> Option<Vec<Move>>,
    ) -> Result<Ending> {
        self.gather();
        let mut left = max_iterations;
        loop {
            cancel.check()?;
            if left == 0 {
                return Ok(Ending::IterationLimit);
            }
            let Some(moves) = next_moves(self) else { return Ok(Ending::Converged) };
            if !moves.is_empty() {
                left -= 1;
                self.apply(&moves);
                on_iteration(Step { energy: self.clusters.energy(), moves: moves.len() as u64 });
            }
        }
    }

    /// What all faces that are due want by the boundary test; None when nothing moves.
    fn boundary_moves(&mut self) -> Option<Vec<Move>> {
        let changed = self.clusters.take_changes(Reader::Boundary);
        let Self { graph, labels, clusters, frontier, boundary_watch, leaving, .. } = self;
        let frontier = frontier.as_ref()?;
        let watch = boundary_watch.get_or_insert_with(|| Watch::new(frontier, graph.faces()));
        watch.wake(graph, labels, frontier, &changed, clusters);
        let moves = boundary::moves(graph, labels, clusters, watch, leaving);
        (!moves.is_empty()).then_some(moves)
    }

    /// Lets the faces that are due bid, and `waiting` ones. Returns whether there are any bids.
    fn renew_bids(&mut self, waiting: Vec<u32>) -> bool {
        let changed = self.clusters.take_changes(Reader::Refinement);
        let Self { graph, labels, clusters, frontier: Some(frontier), refinement_watch, bids, .. } = self else {
            return false;
        };
        let watch = refinement_watch.get_or_insert_with(|| Watch::new(frontier, graph.faces()));
        waiting.into_iter().chain(bids.at(&changed)).for_each(|face| watch.add(face));
        watch.wake(graph, labels, frontier, &changed, clusters);
        bids.renew(graph, labels, clusters, watch);
        !bids.is_empty()
    }

    /// The faces that the last phase of refinement refused, or that still have bids because it was cut short, fit to bid
    /// again; none when that phase goes on.
    fn take_waiting(&mut self) -> Vec<u32> {
        self.gather();
        if std::mem::take(&mut self.resumed) {
            return Vec::new();
        }
        self.bids.end()
    }

    /// The neighbour that each living cluster would best merge with, or [`FREE`] where it has none.
    fn choose_dual_edges(&mut self, ties: Ties) -> Vec<u32> {
        self.gather();
        let Some(frontier) = &mut self.frontier else { return Vec::new() };
        self.living.retain(|&cluster| self.clusters.sums(cluster).faces > 0);
        dual_edges::choose(self.graph, &self.labels, &self.clusters, frontier, &self.living, ties)
    }

    /// The faces outside the largest piece of each cluster, sorted.
    fn cut_off_faces(&mut self) -> Vec<u32> {
        self.gather();
        let unsure = self.clusters.take_changes(Reader::Pieces);
        self.places.resize_with(self.graph.faces(), AtomicU32::default);
        let Some(frontier) = &self.frontier else { return Vec::new() };
        pieces::cut_off(self.graph, &self.labels, &self.clusters, frontier, &unsure, &self.places)
    }

    /// Frees faces and grows the clusters over them.
    fn regrow(&mut self, faces: &[u32], cancel: &Cancel) -> Result<()> {
        let from: Vec<u32> = faces.iter().map(|&face| self.labels.refresh(face)).collect();
        for &face in faces {
            self.labels.set(face, FREE);
        }
        let mut beside: Vec<u32> = faces
            .iter()
            .flat_map(|&face| self.graph.neighbours_of(face).iter().copied())
            .filter(|&near| self.labels.of(near) != FREE)
            .collect();
        beside.sort_unstable();
        beside.dedup();
        self.growth.grow(self.graph, &mut self.labels, beside, cancel)?;
        let moves: Vec<Move> = faces
            .iter()
            .zip(from)
            .map(|(&face, from)| Move { face, from, to: self.labels.of(face) })
            .filter(|moved| moved.to != moved.from)
            .collect();
        // what each move changes is seen when they are made one after the other
        for moved in &moves {
            self.labels.set(moved.face, moved.from);
        }
        self.apply(&moves);
        Ok(())
    }
}

impl Steps for CpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.resumed = false;
        self.labels.replace(labels);
        self.forget();
        self.began_as_faces =
            labels.len() == self.clusters.len() && (0..).zip(labels).all(|(face, &label)| label == face);
        self.living = (0..self.clusters.len() as u32).collect();
        self.queue = None;
        self.left = None;
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        let labels = self.labels.all();
        let beside_free = |face: &u32| {
            labels[*face as usize] != FREE
                && self.graph.neighbours_of(*face).iter().any(|&near| labels[near as usize] == FREE)
        };
        if !labels.contains(&FREE) {
            return Ok(());
        }
        let frontier = (0..labels.len() as u32).filter(beside_free).collect();
        self.forget();
        self.growth.grow(self.graph, &mut self.labels, frontier, cancel)?;
        Ok(())
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        self.sum();
        Ok(self.clusters.energy())
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        // a boundary phase remembers nothing that it could go on without
        self.resumed = false;
        self.optimise(max_iterations, cancel, on_iteration, Self::boundary_moves)
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_iteration: &mut dyn FnMut(Step)) -> Result<Ending> {
        let mut waiting = self.take_waiting();
        self.optimise(max_iterations, cancel, on_iteration, |steps| {
            let has_bids = steps.renew_bids(std::mem::take(&mut waiting));
            has_bids.then(|| steps.bids.moves(steps.graph, &steps.clusters, None))
        })
    }

    fn refine_connected(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let mut waiting = self.take_waiting();
        self.optimise(max_iterations, cancel, on_iteration, |steps| {
            let has_bids = steps.renew_bids(std::mem::take(&mut waiting));
            let Self { graph, labels, clusters, places, bids, .. } = steps;
            places.resize_with(graph.faces(), AtomicU32::default);
            let mut pieces = Pieces::new(places);
            let mut may_leave = |winner: Move| pieces.stays_connected(graph, labels, winner.face);
            has_bids.then(|| bids.moves(graph, clusters, Some(&mut may_leave)))
        })
    }

    fn resume(&mut self) {
        self.resumed = true;
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        let cut_off = self.cut_off_faces();
        if !cut_off.is_empty() {
            self.regrow(&cut_off, cancel)?;
        }
        Ok(cut_off.len() as u64)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        Ok(self.labels.all().to_vec())
    }
}

impl MergeSteps for CpuSteps<'_> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        if let Some((contraction, clusters)) = self.contraction(ties) {
            return Ok(contraction.best(clusters));
        }
        let chosen = self.choose_dual_edges(ties);
        let edge = |(&cluster, &other): (&u32, &u32)| {
            let cost = || dual_edges::price(&self.clusters, cluster, other);
            (other != FREE).then(|| DualEdge { cluster, other, cost: cost() })
        };
        Ok(self.living.iter().zip(&chosen).filter_map(edge).collect())
    }

    fn mutual_dual_edges(&mut self, ties: Ties) -> Result<Vec<Rank<u32>>> {
        if let Some((contraction, clusters)) = self.contraction(ties) {
            return Ok(contraction.mutual(clusters));
        }
        // as `dual_edge::mutual` finds them among the best of all; only the pairs are priced
        let chosen = self.choose_dual_edges(ties);
        self.choices.resize(self.clusters.len(), FREE);
        for (&cluster, &other) in self.living.iter().zip(&chosen) {
            self.choices[cluster as usize] = other;
        }
        let is_mutual = |&(&cluster, &other): &(&u32, &u32)| {
            other != FREE && cluster < other && self.choices[other as usize] == cluster
        };
        let pair = |(&low, &high): (&u32, &u32)| {
            Rank::new(dual_edges::price(&self.clusters, low, high), low, high, Ties::Hash)
        };
        Ok(self.living.iter().zip(&chosen).filter(is_mutual).map(pair).collect())
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        self.gather();
        let Some(frontier) = &mut self.frontier else { return Ok(None) };
        let queue = self.queue.get_or_insert_with(|| dual_edges::Queue::new(self.clusters.len(), ties));
        let cheapest = queue.cheapest(self.graph, &self.labels, &mut self.clusters, frontier);
        Ok(cheapest.map(|edge| edge.ends()))
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        // clusters that lie close together one after the other
        let mut pairs = pairs.to_vec();
        pairs.sort_unstable_by_key(|&(_, into)| into);
        if let Some(contraction) = &mut self.contraction {
            contraction.merge(&self.clusters, &pairs);
        } else {
            self.gather();
        }
        self.labels.merge(self.clusters.len(), &pairs);
        for &(from, into) in &pairs {
            self.clusters.merge(into, from);
        }
        if let Some(frontier) = &mut self.frontier {
            self.labels.renew_after(pairs.len());
            let mut watches = [&mut self.boundary_watch, &mut self.refinement_watch];
            for &(from, into) in &pairs {
                frontier.merged(self.graph, &mut self.labels, into, from, |labels, face| {
                    for watch in watches.iter_mut().filter_map(|watch| watch.as_mut()) {
                        watch.merged(self.graph, labels, face);
                    }
                });
            }
        }
        self.clusters.refit();
        self.left = Some(Vec::new());
        Ok(())
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<ClusterSums>> {
        self.sum();
        Ok(clusters.iter().map(|&cluster| *self.clusters.sums(cluster)).collect())
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        let mut left = self.left.take().unwrap_or_default();
        // the first move of each face tells where it was; the sort is stable
        left.sort_by_key(|&(face, _)| face);
        left.dedup_by_key(|&mut (face, _)| face);
        let moved = left.into_iter().map(|(face, from)| (face, from, self.labels.of(face)));
        Ok(moved.filter(|&(_, from, to)| from != to).collect())
    }
}

#[cfg(test)]
mod tests;
