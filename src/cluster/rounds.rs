//! The rounds of a hierarchical run ([`super::hierarchy`]): merges, optimisation, and what is recorded of them.

use super::fast;
use super::hubs::Hubs;
use super::merging::{PAIRED_ROUNDS, Pairs, chosen, half_mutual};
use super::numbers;
use super::quality::Quality;
use super::relocation::Relocation;
use super::run::{Row, Run};
use super::tree_builder::Builder;
use crate::device::dual_edge::Ties;
use crate::device::{Cancel, MergeSteps, Merges};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::{Error, Result};
use crate::hierarchy::Tree;
use crate::surface::{Items, Moves};
use crate::union_find;

/// Where moves are connected, sequential rounds are optimised when one cluster in so many has merged.
pub(super) const ONE_MERGED_IN: u64 = 100;

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

/// What the merges of a round did.
#[derive(Debug, Clone, Copy)]
struct Merged {
    merges: u64,
    /// Whether it ends at a requested number of clusters.
    is_level: bool,
    is_sequential: bool,
    /// Whether it is optimised.
    is_due: bool,
}

/// The rounds of a run.
pub(super) struct Rounds<'a, E: Functional> {
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
    /// A round that another device ends.
    unfinished: Option<Merged>,
    hubs: Hubs,
    /// The number of clusters at which sequential rounds reached their bound.
    bounded_at: Option<u64>,
    builder: Builder<'a, E>,
    on_row: &'a mut dyn FnMut(Row),
    on_round: &'a mut dyn FnMut(RoundRow),
}

impl<'a, E: Functional> Rounds<'a, E> {
    /// Those that begin with a cluster an item and end with `target` clusters.
    pub(super) fn new(
        items: &'a Items<E>,
        options: &'a Options,
        target: u64,
        cancel: &'a Cancel,
        on_row: &'a mut dyn FnMut(Row),
        on_round: &'a mut dyn FnMut(RoundRow),
    ) -> Self {
        let left = items.faces() as u64;
        Self {
            options,
            target,
            cancel,
            left,
            iteration: 0,
            paired_rounds: 0,
            merged: 0,
            unfinished: None,
            hubs: Hubs::new(items),
            bounded_at: None,
            builder: Builder::new(items, (left - target) as usize),
            on_row,
            on_round,
        }
    }

    /// Whether as many clusters are left as wanted.
    pub(super) fn are_over(&self) -> bool {
        self.left <= self.target
    }

    /// The component that each cluster lies in, while it lives.
    pub(super) fn component_of_cluster(&self) -> Vec<u32> {
        self.builder.component_of_cluster.clone()
    }

    /// The tree, and the number of clusters at which sequential rounds reached their bound.
    pub(super) fn end(self) -> (Tree, Option<u64>) {
        (self.builder.tree, self.bounded_at)
    }

    /// Makes rounds to the end, or until whole clusters have moved at a stop. Returns the labels.
    pub(super) fn until_relocated(&mut self, steps: &mut dyn MergeSteps<E>) -> Result<Vec<u32>> {
        while self.unfinished.is_some() || !self.are_over() {
            let merged = match self.unfinished.take() {
                // moves count from here on, as after a merge
                Some(merged) => steps.merge(&[]).map(|()| merged)?,
                None => self.merges(steps)?,
            };
            if let Some(labels) = self.end_round(steps, merged)? {
                return Ok(labels);
            }
        }
        steps.labels()
    }

    /// How many clusters are left, at most, after [`until_optimised`](Self::until_optimised); None where no round is
    /// optimised, or the first may be.
    pub(super) fn left_by_merges(&self) -> Option<u64> {
        let Options { sequential_at, optimise, optimised_from, levels, .. } = self.options;
        let optimised = self.left / (*optimised_from).max(1) + self.builder.items.components.len() as u64;
        let most = levels.iter().fold(optimised.max(self.target).max(*sequential_at), |most, &level| most.max(level));
        (*optimise && most < self.left).then_some(most)
    }

    /// Makes rounds from these labels to the first that is optimised, without its end, or until rounds are sequential.
    /// Returns the labels.
    pub(super) fn until_optimised(&mut self, steps: &mut dyn MergeSteps<E>, labels: &[u32]) -> Result<Vec<u32>> {
        steps.set_labels(labels)?;
        while self.left > self.target.max(self.options.sequential_at) {
            let merged = self.merges(steps)?;
            if merged.is_due {
                self.unfinished = Some(merged);
                break;
            }
            self.end_round(steps, merged)?;
        }
        steps.labels()
    }

    /// Begins a round: merges clusters.
    fn merges(&mut self, steps: &mut dyn MergeSteps<E>) -> Result<Merged> {
        self.cancel.check()?;
        let Options { levels, clusters, .. } = self.options;
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
        let is_due = is_level || if is_sequential { self.is_due() } else { self.are_large() };
        Ok(Merged { merges, is_level, is_sequential, is_due: self.options.optimise && is_due })
    }

    /// Ends a round after its merges: optimises clusters, and records it. Returns the labels if whole clusters have
    /// moved, which the device does not know.
    fn end_round(&mut self, steps: &mut dyn MergeSteps<E>, merged: Merged) -> Result<Option<Vec<u32>>> {
        let Merged { merges, is_level, is_sequential, is_due } = merged;
        let items = self.builder.items;
        let round = self.builder.tree.rounds.len() as u32 + 1;
        let mut moves = Vec::new();
        let mut relocated = None;
        let mut energy = None;
        if is_due {
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
            self.hubs.moved(items, &moves, is_sequential && !is_level);
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
            let pair = pair.ok_or_else(|| Error::internal("there is no dual edge left to collapse"))?;
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
