//! Hierarchical clustering: parallel multilevel (PML), multilevel (ML) and without optimisation (P§4, P§5.4).
//!
//! # Definition
//!
//! Every face starts as a cluster. A round merges clusters and then optimises:
//!
//! * *Parallel rounds* (PML): every cluster finds its best dual edge ([`crate::device::dual_edge`]: packed cost, then
//!   the tie rule); of the pairs that chose each other, those that cost no more than their median merge, or others
//!   ([`Pairs`]; in the paper, all), all at once. The edges are totally ordered (or, with the paper's tie rule, the
//!   cluster with the largest number among those of the cheapest edges has a partner that chose it back), so there is
//!   always such a pair while a dual edge is left.
//! * *Sequential rounds* (ML): the dual edge with the smallest exact cost of all merges; with `collapse_fraction` P,
//!   one after the other until P % of the clusters are gone (Chiosa & Kolb 2008).
//! * *Optimisation*: the boundary phase and the refinement of [`super::flat`], on the merged clusters. Between stops,
//!   parallel rounds make only a few iterations (2), and the next round goes on where they ended. Then pieces that were
//!   cut off are given to their neighbours. Parallel rounds are optimised when clusters have 4 faces on average
//!   ([`Options::optimised_from`]), stops always. Both numbers are those of the default [`Quality`].
//!   Where moves are connected, an optimisation looks at all items, so sequential rounds are optimised when one cluster
//!   in [`ONE_MERGED_IN`] has merged since the last one.
//!
//! Of two clusters that merge, the one with more faces keeps its number, the smaller number of equal ones. Clusters
//! start with the internal number of their face.
//!
//! Around a *hub* ([`super::hubs`]), one pair merges a round. So a parallel round merges pairs of which one chose the
//! other, the cheaper half of them one after the other, when there were [`PAIRED_ROUNDS`] since the last stop; and
//! sequential rounds end at a bound, after which rounds do the same.
//!
//! Without optimisation the tree is nested: parallel hierarchical clustering, or with sequential rounds exact greedy
//! Ward clustering on the lattice (Garland et al. 2001).
//!
//! A run stops at `clusters`, at each of `levels` and at one cluster a component, at exactly those numbers: a round
//! that would pass one merges only its cheapest pairs. There the phases run until no cluster is in pieces, as in a flat
//! run, and whole clusters move ([`super::relocation`]), into other components, too. A cluster keeps its number where
//! it keeps most of its faces ([`numbers`]); all faces that are in another cluster than before count as moved.
//!
//! Merging all pairs would halve the clusters also where they are large already; the next round moves what a few
//! iterations leave; clusters of two or three faces leave little to optimise (`benches/results/choices.md`).

use std::time::{Duration, Instant};

use super::fast;
use super::hubs::Hubs;
use super::merging::{PAIRED_ROUNDS, Pairs, chosen, half_mutual};
use super::numbers;
use super::quality::Quality;
use super::relocation::Relocation;
use super::run::{Row, Run};
use super::seeds::check_number;
use super::tree_builder::Builder;
use crate::device::dual_edge::Ties;
use crate::device::{Cancel, Device, MergeSteps, Merges};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::names::Name;
use crate::error::{Error, Kind, Result};
use crate::hierarchy::Tree;
use crate::surface::{Items, Moves};
use crate::union_find;

/// Where moves are connected, sequential rounds are optimised when one cluster in so many has merged.
const ONE_MERGED_IN: u64 = 100;

/// What to build.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Rounds are sequential from this number of clusters on: 0 for never, `u64::MAX` for always.
    pub sequential_at: u64,
    /// Percentage of the clusters that a sequential round merges; one merge a round when left out.
    pub collapse_fraction: Option<f64>,
    /// Optimise after the merges of a round.
    pub optimise: bool,
    /// Refine what the boundary phase has converged to.
    pub refine: bool,
    /// Iterations of optimisation a round, except at stops: parallel rounds, and sequential ones.
    pub iterations_a_round: [u32; 2],
    /// Faces a cluster from which on parallel rounds are optimised: those of the mesh over the clusters that are left
    /// beyond one a component. Stops are in any case.
    pub optimised_from: u64,
    /// Which pairs merge in parallel rounds.
    pub pairs: Pairs,
    /// Which of equally cheap dual edges is the best.
    pub ties: Ties,
    /// Where to end; one cluster a component when left out.
    pub clusters: Option<u64>,
    /// Numbers of clusters to stop at on the way.
    pub levels: Vec<u64>,
    /// Leave clusters in the pieces that the optimisation left.
    pub allow_disconnected: bool,
    /// The quality whose moves of whole clusters follow at stops, if any.
    pub relocation: Option<Quality>,
}

/// What a round did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoundRow<Energy = LatticeEnergy> {
    /// Number of the round, from 1.
    pub round: u32,
    /// Clusters left after it.
    pub clusters: u64,
    /// Energy after it.
    pub energy: Energy,
    /// Pairs that merged.
    pub merges: u64,
    /// Faces that belong elsewhere after the optimisation than after the merges.
    pub moves: u64,
    /// Whether it ended at a requested number of clusters.
    pub is_level: bool,
}

/// A hierarchy that was built.
#[derive(Debug)]
pub struct Hierarchy {
    /// The merges and moves.
    pub tree: Tree,
    /// Those of the last round, internal order.
    pub labels: Vec<u32>,
    /// The number of clusters at which sequential rounds reached their bound.
    pub bounded_at: Option<u64>,
    /// Time that the device took to open.
    pub upload: Duration,
}

/// Builds a hierarchy.
///
/// `on_row` is called with every iteration of parallel rounds, `on_round` with every round.
pub fn hierarchical<E: Functional>(
    items: &Items<E>,
    options: &Options,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
    on_round: &mut dyn FnMut(RoundRow),
) -> Result<Hierarchy> {
    let faces = items.faces() as u64;
    let target = check(items, options)?;
    let builder = Builder::new(items, (faces - target) as usize);
    let mut rounds = Rounds {
        options,
        target,
        cancel,
        left: faces,
        iteration: 0,
        paired_rounds: 0,
        merged: 0,
        hubs: Hubs::new(items),
        bounded_at: None,
        builder,
        on_row,
        on_round,
    };
    let mut labels: Vec<u32> = (0..faces as u32).collect();
    let mut upload = Duration::ZERO;
    while rounds.left > target {
        // a device knows the component of each cluster, so it is opened anew when clusters have gone to others
        let component_of_cluster = rounds.builder.component_of_cluster.clone();
        let opened = Instant::now();
        let mut steps = device.open_merging(items, &component_of_cluster)?;
        upload += opened.elapsed();
        steps.set_labels(&labels)?;
        labels = rounds.until_relocated(steps.as_mut())?;
    }
    Ok(Hierarchy { tree: rounds.builder.tree, labels, bounded_at: rounds.bounded_at, upload })
}

/// The rounds of a run.
struct Rounds<'a, E: Functional> {
    options: &'a Options,
    /// Clusters to end with.
    target: u64,
    cancel: &'a Cancel,
    /// Clusters that are left.
    left: u64,
    /// Number of the last row.
    iteration: u32,
    /// Parallel rounds since the last stop.
    paired_rounds: u32,
    /// Merges since the last optimisation.
    merged: u64,
    hubs: Hubs,
    /// The number of clusters at which sequential rounds reached their bound.
    bounded_at: Option<u64>,
    builder: Builder<'a, E>,
    on_row: &'a mut dyn FnMut(Row),
    on_round: &'a mut dyn FnMut(RoundRow),
}

impl<E: Functional> Rounds<'_, E> {
    /// Makes rounds to the end, or until whole clusters have moved at a stop. Returns the labels.
    fn until_relocated(&mut self, steps: &mut dyn MergeSteps<E>) -> Result<Vec<u32>> {
        while self.left > self.target {
            if let Some(labels) = self.round(steps)? {
                return Ok(labels);
            }
        }
        steps.labels()
    }

    /// Makes a round. Returns the labels if whole clusters have moved, which the device does not know.
    fn round(&mut self, steps: &mut dyn MergeSteps<E>) -> Result<Option<Vec<u32>>> {
        self.cancel.check()?;
        let Options { levels, clusters, .. } = self.options;
        let items = self.builder.items;
        let round = self.builder.tree.rounds.len() as u32 + 1;
        let left = self.left;
        let stop = levels.iter().copied().filter(|&level| level < left).fold(self.target, u64::max);
        let is_sequential = left <= self.options.sequential_at && self.bounded_at.is_none();
        let merges = if is_sequential {
            let wanted = self.options.collapse_fraction.map_or(1, |percent| (left as f64 * percent / 100.0) as u64);
            self.merge_cheapest(steps, wanted.clamp(1, left - stop))?
        } else {
            self.merge_parallel(steps, (left - stop) as usize)?
        };
        self.left -= merges;
        self.merged += merges;
        if self.bounded_at.is_none() && self.left > self.target && self.hubs.are_bounded() {
            self.bounded_at = Some(self.left);
        }
        let is_level = self.left == stop && (levels.contains(&stop) || *clusters == Some(stop));
        let mut moves = Vec::new();
        let mut relocated = None;
        let mut energy = None;
        let is_due = if is_sequential { self.is_due() } else { self.are_large() };
        if self.options.optimise && (is_level || is_due) {
            self.merged = 0;
            let on_row: &mut dyn FnMut(Row) = if is_sequential && !is_level { &mut |_| {} } else { &mut self.on_row };
            let mut run = Run { round: Some(round), iteration: self.iteration, ..Run::new(steps, self.cancel, on_row) };
            optimise(&mut run, items, self.options, is_level, is_sequential)?;
            self.iteration = run.iteration;
            moves = steps.moves_since_merge()?;
            if let Some(quality) = self.options.relocation.filter(|_| is_level)
                && let Some((labels, after)) = self.relocated(steps, quality, round)?
            {
                moves = moves_to(&labels, steps.labels()?, &moves);
                (relocated, energy) = (Some(labels), Some(after));
            }
            self.builder.moves(&moves);
            self.hubs.moved(items, &moves);
            if let Some(labels) = &relocated {
                self.builder.component_of_cluster = items.component_of_cluster(labels, items.faces());
            }
        }
        if is_level {
            self.paired_rounds = 0;
        }
        let energy = energy.map_or_else(|| steps.energy(), Ok)?;
        self.builder.end_round(self.left, items.energy(energy));
        let moves = moves.len() as u64;
        (self.on_round)(RoundRow { round, clusters: self.left, energy, merges, moves, is_level });
        Ok(relocated)
    }

    /// Merges the cheapest dual edge of all, `times` times or until hubs are at their bound. Returns how often.
    fn merge_cheapest(&mut self, steps: &mut dyn MergeSteps<E>, times: u64) -> Result<u64> {
        let mut merges = 0;
        while merges < times && !self.hubs.are_bounded() {
            let pair = steps.cheapest_dual_edge(self.options.ties)?;
            let pair = pair.ok_or_else(|| Error::new(Kind::Internal, "there is no dual edge left to collapse"))?;
            let into = self.merge(steps, &[pair])?.first().map_or(pair.0, |&(_, into)| into);
            self.hubs.count(into, self.options.optimise);
            merges += 1;
        }
        Ok(merges)
    }

    /// Merges what chose each other, `most` pairs at most; around hubs, of what one of both chose. Returns how many.
    fn merge_parallel(&mut self, steps: &mut dyn MergeSteps<E>, most: usize) -> Result<u64> {
        let Options { ties, pairs, .. } = *self.options;
        self.paired_rounds += 1;
        if self.paired_rounds <= PAIRED_ROUNDS && self.bounded_at.is_none() {
            let pairs = chosen(steps.mutual_dual_edges(ties)?, pairs, most)?;
            return Ok(self.merge(steps, &pairs)?.len() as u64);
        }
        let mut merged_into = union_find::singletons(self.builder.items.faces());
        let mut merges = 0;
        for (low, high) in chosen(half_mutual(&steps.optimal_dual_edges(ties)?), pairs, most)? {
            self.cancel.check()?;
            let [a, b] = [low, high].map(|cluster| union_find::root(&mut merged_into, cluster));
            if a != b {
                for (from, into) in self.merge(steps, &[(a.min(b), a.max(b))])? {
                    merged_into[from as usize] = into;
                    merges += 1;
                }
            }
        }
        Ok(merges)
    }

    /// Merges pairs, of which no cluster is in two, and records them. Returns them as (from, into).
    fn merge(&mut self, steps: &mut dyn MergeSteps<E>, pairs: &[(u32, u32)]) -> Result<Merges> {
        let (ordered, sums) = steps.merge_pairs(pairs)?;
        self.builder.merge(&ordered, sums.as_chunks().0);
        ordered.iter().for_each(|&(from, into)| self.hubs.merged(from, into));
        Ok(ordered)
    }

    /// Whether enough clusters have merged to be optimised.
    fn is_due(&self) -> bool {
        self.builder.items.moves == Moves::Free || self.merged * ONE_MERGED_IN >= self.left
    }

    /// Whether clusters have enough faces to be optimised; one that is all of its component does not count.
    fn are_large(&self) -> bool {
        let items = self.builder.items;
        items.faces() as u64 >= self.options.optimised_from * (self.left - items.components.len() as u64)
    }

    /// Moves whole clusters. Returns labels and energy if that lowers it.
    fn relocated(
        &mut self,
        steps: &mut dyn MergeSteps<E>,
        quality: Quality,
        round: u32,
    ) -> Result<Option<(Vec<u32>, LatticeEnergy)>> {
        let before = steps.labels()?;
        let mut energy = None;
        let Options { pairs, .. } = *self.options;
        let relocation = Relocation { graph: self.builder.items, quality, pairs, cancel: self.cancel };
        let flat = || fast::labels(self.builder.items, self.left, 0, self.cancel);
        let after = relocation.labels_from(numbers::compact(&before), flat, &mut |phase, after, moves, _| {
            energy = Some(after);
            self.iteration += 1;
            let row = Row { iteration: self.iteration, round: Some(round), phase, energy: after, moves };
            (self.on_row)(row);
        })?;
        Ok(energy.map(|energy| (numbers::kept(&before, &after), energy)))
    }
}

/// The moves to these labels from those after the merges, given the present ones and the moves to them.
fn moves_to(labels: &[u32], present: Vec<u32>, moves: &[(u32, u32, u32)]) -> Vec<(u32, u32, u32)> {
    let mut before = present;
    moves.iter().for_each(|&(face, from, _)| before[face as usize] = from);
    let changes = (0..).zip(before).zip(labels).filter(|((_, from), to)| from != *to);
    changes.map(|((face, from), &to)| (face, from, to)).collect()
}

/// Where to end. Refuses numbers that this surface cannot have.
pub fn check<E: Functional>(items: &Items<E>, options: &Options) -> Result<u64> {
    options.clusters.iter().try_for_each(|&number| check_number(items, Name::CLUSTERS, number))?;
    options.levels.iter().try_for_each(|&number| check_number(items, Name::LEVELS, number))?;
    let target = options.clusters.unwrap_or(items.components.len() as u64);
    if let Some(level) = options.levels.iter().find(|&&level| level < target) {
        return Err(Error::parameter(format_args!(
            "{} must not be below {}, {target}: {level}",
            Name::LEVELS,
            Name::CLUSTERS
        )));
    }
    Ok(target)
}

/// The phases after the merges of a round.
fn optimise<E: Functional>(
    run: &mut Run<'_>,
    items: &Items<E>,
    options: &Options,
    is_level: bool,
    is_sequential: bool,
) -> Result<()> {
    if is_level {
        run.complete(items, options.allow_disconnected, |run| run.optimise(items, options.refine))?;
        return Ok(());
    }
    run.left = options.iterations_a_round[usize::from(is_sequential)];
    run.optimise(items, options.refine)?;
    if items.moves == Moves::Free && !options.allow_disconnected {
        run.repair()?;
    }
    Ok(())
}
