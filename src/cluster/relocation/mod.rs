//! Relocation: moves of whole clusters, which follow the phases. `docs/uneven.md` says why.
//!
//! # Definition
//!
//! *Starts.* Each makes [swaps](swap) until none pays. The first is what the phases end with. The others are
//! [merged](super::merging) from single faces (from [groups](super::grouping) of them where there are many and
//! [`Moves`] are connected), and the phases of quality `fast`, once as they are (not where moves are connected) and
//! once [settled](mod@super::connected::settle) before the swaps. Each is [mixed](mix) in: every component comes from
//! where it is cheaper. Where moves are free, what `fast` ends with is among them, so that no other quality ends above
//! it.
//!
//! *Improvement.* A round of [trials](trial) of merges and splits, judged after their surroundings have settled, and a
//! [breath](mod@breathe), more clusters and then as many again, take turns: what one has made of its clusters, the
//! other lowers further.
//!
//! Quality `fast` only makes swaps. The default makes the starts of `fast` where a swap might pay, and the merged one
//! if swaps lowered F by a thousandth, or the mesh is *uneven*: fewer than one face in [`UNEVEN`] is *effective*, which
//! is as many equal ones as would have the same Σ w² and the same Σ w, (Σ w)²/Σ w². Trials and breaths follow then, and
//! also where clusters have fewer than [`FEW_FACES`] effective faces. On small meshes they follow below [`MANY_FACES`],
//! too, and up to [`FEW_CLUSTERS`], where the result of ACVD is another start. `best` goes on as long as F falls, and
//! mixes in the results of cheaper jobs (around hubs not of `acvd`).
//!
//! Levels of hierarchies have two starts ([`Relocation::labels_from`]): their merges, and the settled one.
//!
//! # F never rises, and it ends
//!
//! Every step returns what it got, or something with a lower F, with as many clusters, each of them connected. Nothing
//! depends on the device: the steps are exact integer arithmetic on the host, and bounds in f64, in a fixed order, only
//! leave out work.

mod breathe;
mod mix;
mod offers;
mod resize;
mod split;
mod swap;
mod trial;

use self::breathe::breathe;
use self::mix::mixed;
use self::offers::Offers;
use self::resize::resize;
use super::connected::Clusters;
use super::connected::settle::settle;
use super::grouping;
use super::merging::{self, Pairs};
use super::numbers;
use super::quality::Quality;
use super::run::Phase;
use crate::device::{Cancel, Device, Ending};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::Result;
use crate::surface::{DualGraph, Moves};

/// Clusters with fewer effective faces than this get trials and breaths even if no swap pays.
const FEW_FACES: usize = 20;

/// The same on small meshes.
const MANY_FACES: usize = 45;

/// Where moves are free, meshes with fewer effective faces than one in this many are uneven: starts differ by more than
/// swaps make up for.
const UNEVEN: usize = 8;

/// Meshes with no more faces than this are small.
pub const SMALL: usize = 1 << 15;

/// Up to this number of faces, all moves together take little time.
const FEW_IN_ALL: usize = 1 << 12;

/// Up to this number of clusters, the default mixes in the result of `acvd` on small meshes, and makes more turns on
/// uneven ones.
pub const FEW_CLUSTERS: usize = 32;

/// Turns of a round of trials and a breath, unless all are made.
const TURNS: usize = 2;

/// The same on small meshes where [`Moves`] are free, and up to [`FEW_CLUSTERS`] on uneven ones.
const MORE_TURNS: usize = 5;

/// Rounds of trials before the results of cheaper jobs are mixed in, and the fewest where all are made.
const TRIALS: usize = 3;

/// Rounds of trials and breaths, at most.
const MOST_ROUNDS: usize = 60;

/// Rounds of trials and breaths have no more faces together than this, but [`TRIALS`] are made in any case.
const FACES_IN_ROUNDS: usize = 4_000_000;

/// Called with each change of the clusters: its kind, F after it, faces that moved, and their labels.
pub type OnChange<'a> = &'a mut dyn FnMut(Phase, LatticeEnergy, u64, &[u32]);

/// A relocation: what it works with.
pub struct Relocation<'a, E: Functional> {
    /// The faces.
    pub graph: &'a DualGraph<E>,
    /// Which steps are made.
    pub quality: Quality,
    /// Which pairs of clusters merge in a round of the merged start.
    pub pairs: Pairs,
    /// Ends it early.
    pub cancel: &'a Cancel,
}

impl<'a, E: Functional> Relocation<'a, E> {
    /// Makes all steps from labels in which every cluster has faces and is connected. Returns labels with as many
    /// clusters, and whether a bound on work cut steps short that led to them. `device` merges single faces; `fast`
    /// computes the labels of the phases of that quality, and `cheaper` other labels, where they are worth it.
    pub fn labels(
        &self,
        labels: Vec<u32>,
        device: &mut dyn Device<E>,
        fast: impl FnOnce() -> Result<Vec<u32>>,
        cheaper: impl Iterator<Item = Result<Vec<u32>>>,
        on_change: OnChange<'_>,
    ) -> Result<(Vec<u32>, Ending)> {
        let is_uneven = self.quality != Quality::Fast && self.is_uneven();
        if self.quality != Quality::Best && !is_uneven && self.no_swap_can_pay(&labels) {
            return Ok((labels, Ending::Converged));
        }
        let (mut run, has_paid) = Improvement::after_swaps(self, labels, on_change)?;
        let pays = has_paid || is_uneven;
        let clusters = run.best.clusters.count();
        let tries_more = self.tries_more(clusters, pays);
        if tries_more && pays {
            let merge = if self.merges_groups() { grouping::merged } else { merging::merged };
            let merged = merge(self.graph, clusters, self.pairs, device, self.cancel)?;
            run.mix_in_start(Phase::MergedStart, merged)?;
        }
        if tries_more && self.quality == Quality::Best {
            run.relax(TRIALS)?;
        }
        if self.quality != Quality::Fast {
            let fast = fast()?;
            if self.graph.moves == Moves::Free {
                let mut other = Offers::new(self.graph, fast.clone());
                swap::swap(&mut other, self.cancel, |_| {})?;
                run.mix_in(Phase::FastStart, other)?;
            }
            run.mix_in_start(Phase::SettledStart, fast)?;
        }
        for labels in cheaper {
            match self.graph.moves {
                Moves::Free => run.mix_in(Phase::OtherJob, Offers::new(self.graph, labels?))?,
                // merges alone have not settled
                Moves::Connected => run.mix_in_start(Phase::OtherJob, labels?)?,
            }
        }
        if tries_more {
            run.relax_and_breathe()?;
        }
        Ok(run.ended())
    }

    /// Swaps, trials and breaths from labels of a hierarchy, mixed with a flat start, which `flat` computes where it is
    /// worth it.
    pub fn labels_from(
        &self,
        labels: Vec<u32>,
        flat: impl FnOnce() -> Result<Vec<u32>>,
        on_change: OnChange<'_>,
    ) -> Result<Vec<u32>> {
        if self.no_swap_can_pay(&labels) {
            return Ok(labels);
        }
        let (mut run, has_paid) = Improvement::after_swaps(self, labels, on_change)?;
        if self.tries_more(run.best.clusters.count(), has_paid) {
            if has_paid {
                run.mix_in_start(Phase::SettledStart, flat()?)?;
            }
            run.relax_and_breathe()?;
        }
        Ok(run.ended().0)
    }

    /// Labels after all clusters have settled and made swaps until none pays; on few faces, after trials and breaths,
    /// too. Also returns whether a bound on work ended that.
    pub fn improved(&self, labels: Vec<u32>) -> Result<(Vec<u32>, Ending)> {
        let mut run = Improvement { of: self, best: Offers::new(self.graph, labels), on_change: &mut |_, _, _, _| {} };
        settle_and_swap(&mut run.best, self.cancel)?;
        if self.graph.faces() <= FEW_IN_ALL {
            run.relax_and_breathe()?;
        }
        Ok(run.ended())
    }

    /// Whether bounds show that no swap pays, and nothing else is worth it.
    fn no_swap_can_pay(&self, labels: &[u32]) -> bool {
        let clusters = labels.iter().max().map_or(0, |&last| last as usize + 1);
        // items that are no positions leave swaps that pay
        self.graph.moves == Moves::Free
            && !self.tries_more(clusters, false)
            && !swap::may_pay(self.graph, labels, clusters)
    }

    /// Whether the merged start is of groups of faces: it ends as low, in a fraction of the time.
    fn merges_groups(&self) -> bool {
        self.quality != Quality::Best && self.graph.moves == Moves::Connected && self.graph.faces() > SMALL
    }

    /// Whether few faces make up most of the mesh.
    fn is_uneven(&self) -> bool {
        self.graph.moves == Moves::Free && effective_faces(self.graph) < self.graph.faces() / UNEVEN
    }

    /// Whether trials and breaths are worth it; `pays` where swaps were, or the mesh is uneven.
    fn tries_more(&self, clusters: usize, pays: bool) -> bool {
        let is_small = self.graph.faces() <= SMALL;
        match self.quality {
            Quality::Fast => false,
            Quality::Default if is_small && clusters <= FEW_CLUSTERS => true,
            Quality::Default if is_small => pays || effective_faces(self.graph) < MANY_FACES * clusters,
            Quality::Best if is_small => true,
            Quality::Default | Quality::Best => pays || effective_faces(self.graph) < FEW_FACES * clusters,
        }
    }
}

/// The steps of a relocation, on the clusters with the lowest F so far.
struct Improvement<'r, 'a, E: Functional> {
    of: &'r Relocation<'a, E>,
    best: Offers<'a, E>,
    on_change: OnChange<'r>,
}

impl<'r, 'a, E: Functional> Improvement<'r, 'a, E> {
    /// Begins with swaps. Also returns whether they lowered F by more than a thousandth.
    fn after_swaps(of: &'r Relocation<'a, E>, labels: Vec<u32>, on_change: OnChange<'r>) -> Result<(Self, bool)> {
        let mut run = Self { of, best: Offers::new(of.graph, labels), on_change };
        let before = run.best.clusters.energy().explained;
        run.swap()?;
        let fall = run.best.clusters.energy().explained - before;
        let has_paid = fall > 0 && fall > run.best.clusters.total() / 1000;
        Ok((run, has_paid))
    }

    /// The labels, and whether a bound on work cut steps short.
    fn ended(&self) -> (Vec<u32>, Ending) {
        (numbers::compact(self.best.clusters.labels()), self.best.clusters.ending())
    }

    fn swap(&mut self) -> Result<()> {
        let Self { of, best, on_change } = self;
        swap::swap(best, of.cancel, |clusters| report(Phase::Swap, clusters, on_change))
    }

    /// Takes the lowest of two clusterings and their mix. `phase` names the second.
    fn mix_in(&mut self, phase: Phase, mut other: Offers<'a, E>) -> Result<()> {
        let Self { of: Relocation { graph, cancel, .. }, best, on_change } = self;
        let (wanted, before) = (best.clusters.count(), best.clusters.energy());
        if other.clusters.energy() > before {
            std::mem::swap(best, &mut other);
        }
        let cluster_worth = best.merges().first().map_or(0, |&(cost, ..)| cost);
        if let Some(labels) = mixed(&best.clusters, &other.clusters, cluster_worth) {
            let mut mix = Offers::new(graph, labels);
            if resize(&mut mix, wanted, cancel)? {
                settle_and_swap(&mut mix, cancel)?;
                if mix.clusters.energy() > best.clusters.energy() {
                    *best = mix;
                }
            }
        }
        if best.clusters.energy() > before {
            report(phase, &mut best.clusters, on_change);
        }
        Ok(())
    }

    /// The same with another start, settled and after its own swaps.
    fn mix_in_start(&mut self, phase: Phase, labels: Vec<u32>) -> Result<()> {
        let mut other = Offers::new(self.of.graph, labels);
        settle_and_swap(&mut other, self.of.cancel)?;
        self.mix_in(phase, other)
    }

    /// Rounds of trials, each followed by swaps, until one keeps none.
    fn relax(&mut self, rounds: usize) -> Result<()> {
        for _ in 0..rounds {
            if trial::round(&mut self.best, self.of.cancel)? == 0 {
                break;
            }
            report(Phase::Trial, &mut self.best.clusters, self.on_change);
            self.swap()?;
        }
        Ok(())
    }

    /// Trials and breaths, in turns, or each as long as F falls, but fewer on large meshes.
    fn relax_and_breathe(&mut self) -> Result<()> {
        let Relocation { graph, quality, .. } = *self.of;
        let clusters = self.best.clusters.count();
        let is_uneven = self.of.is_uneven();
        let (turns, rounds) = match quality {
            Quality::Best => (1, (FACES_IN_ROUNDS / graph.faces()).clamp(TRIALS, MOST_ROUNDS)),
            Quality::Default | Quality::Fast if graph.moves == Moves::Free && graph.faces() <= SMALL => (MORE_TURNS, 1),
            Quality::Default | Quality::Fast if is_uneven && clusters <= FEW_CLUSTERS => (MORE_TURNS, 1),
            Quality::Default | Quality::Fast => (TURNS, 1),
        };
        let mut depth = breathe::first_depth(clusters, is_uneven);
        for _ in 0..turns {
            self.relax(rounds)?;
            for _ in 0..rounds {
                if breathe(&mut self.best, &mut depth, self.of.cancel)? {
                    report(Phase::Breathe, &mut self.best.clusters, self.on_change);
                }
            }
        }
        Ok(())
    }
}

/// (Σ w)²/Σ w² over all faces. Units of finer components than the coarsest are rounded down.
fn effective_faces<E: Functional>(graph: &DualGraph<E>) -> usize {
    let coarsest = graph.components.iter().map(|component| component.energy_shift).max().unwrap_or(0);
    let (mut sum, mut squares) = (0u128, 0u128);
    for component in &graph.components {
        let weights = graph.weights[component.range()].iter().map(|&weight| u128::from(weight));
        let finer = coarsest - component.energy_shift;
        sum += weights.clone().sum::<u128>() >> finer;
        squares += weights.map(|weight| weight * weight).sum::<u128>() >> (2 * finer);
    }
    usize::try_from(sum.saturating_mul(sum) / squares.max(1)).unwrap_or(usize::MAX)
}

/// Settles all clusters, and makes swaps until none pays.
fn settle_and_swap<E: Functional>(offers: &mut Offers<'_, E>, cancel: &Cancel) -> Result<()> {
    let all = offers.clusters.numbers().collect();
    settle(&mut offers.clusters, all, u32::MAX, cancel)?;
    swap::swap(offers, cancel, |_| {})
}

fn report<E: Functional>(phase: Phase, clusters: &mut Clusters<'_, E>, on_change: OnChange<'_>) {
    let moves = clusters.take_moves();
    on_change(phase, clusters.energy(), moves, clusters.labels());
}

#[cfg(test)]
pub(in crate::cluster) mod tests;
