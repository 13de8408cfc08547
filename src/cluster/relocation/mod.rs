//! Relocation: moves of whole clusters, which follow the phases of a flat clustering.
//!
//! The phases move single faces. Where faces are uneven, they end far above what the same number of clusters can reach:
//! each component keeps the clusters that its area gave it, light faces between heavy ones hold borders, and no single
//! move pays where a merge and a split at once would.
//!
//! # Definition
//!
//! *Starts.* Each makes [swaps](swap) until none pays. The first is what the phases end with. The others are
//! [merged](super::merging) from single faces, and the phases of quality `fast`, once as they are and once
//! [settled](mod@settle) before the swaps. Each is [mixed](mix) in: every component comes from where it is cheaper.
//! What `fast` ends with is among them, so that no other quality ends above it.
//!
//! *Improvement.* A round of [trials](trial) of merges and splits, judged after their surroundings have settled, and a
//! [breath](mod@breathe), more clusters and then as many again, take turns.
//!
//! Quality `fast` only makes swaps. The default makes the starts of `fast` where a swap might pay, and the merged one
//! if swaps lowered F by a thousandth. Trials and breaths follow then, and also where clusters have fewer than
//! [`FEW_FACES`] *effective* faces: as many equal ones as would have the same Σ w² and the same Σ w, (Σ w)²/Σ w². The
//! default makes [`TURNS`] of them, on small meshes [`MORE_TURNS`]. `best` goes on as long as F falls, and mixes in the
//! results of cheaper jobs, so that its own is not above any of them (around hubs not of `acvd`).
//! ([`super::coarse`] is where phases start.)
//!
//! On small meshes the default makes trials and breaths also where clusters have fewer than [`MANY_FACES`] effective
//! faces. With more, they gain 0.1 % for half as much time again (sphere and knot of 5,000 faces, 100 clusters). Up to
//! [`FEW_CLUSTERS`], whatever the start is, another may end a per cent lower: there it mixes in the result of ACVD.
//!
//! Why in turns: trials move a cluster at a time, breaths many; what one of them has made of its clusters, the other
//! lowers further. Two turns end 0.1 to 0.9 % below three rounds of trials and a breath on small smooth meshes. Five
//! take 1.3 times as long as two, and none of 146 cases then ends more than 0.5 % above an algorithm of the first
//! version (`benches/results/2026-11-24-two-cores/uneven.md`).
//!
//! Why starts: on uneven meshes the start decides, no finer step makes up for it. Without `fast`, the default ended
//! eight times above it on a bar of long triangles. Settled first, it ends 6 to 8 % lower on turned parts.
//!
//! Levels of hierarchies have two starts ([`Relocation::labels_from`]): their merges, and the settled one.
//!
//! # F never rises, and it ends
//!
//! Every step returns what it got, or something with a lower F. Swaps and trials lower F in each round; starts, mixes
//! and breaths are compared with what there is, and discarded unless they are lower. Every step keeps the number of
//! clusters, and each of them connected.
//!
//! Nothing depends on the device: the steps are exact integer arithmetic on the host, and bounds in f64, in a fixed
//! order, only leave out work. On even meshes a pass over the mesh shows that no swap pays ([`gate`]), and nothing else
//! is done; `best` mixes in the results of cheaper jobs there, too.

mod breathe;
mod candidates;
mod clusters;
mod connection;
mod gate;
mod mix;
mod resize;
pub mod settle;
mod split;
mod swap;
mod totals;
mod trial;

use self::breathe::Breath;
use self::candidates::Candidates;
pub use self::clusters::Clusters;
pub use self::connection::Connection;
use self::mix::mixed;
use self::resize::resize;
use self::settle::settle;
pub use self::totals::Totals;
use super::merging::{self, Pairs};
use super::run::Phase;
use crate::device::{Cancel, Device, Ending};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::Result;
use crate::surface::{DualGraph, Moves};

/// Which steps are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effort {
    /// Swaps.
    Swaps,
    /// All steps, trials and breaths a few times.
    Some,
    /// All steps, as long as F falls.
    All,
}

/// Clusters with fewer effective faces than this get trials and breaths even if no swap pays.
const FEW_FACES: usize = 20;

/// The same on small meshes.
const MANY_FACES: usize = 45;

/// Meshes with no more faces than this are small.
const SMALL: usize = 1 << 15;

/// Up to this number of clusters, the default mixes in the result of `acvd` on small meshes.
pub const FEW_CLUSTERS: usize = 32;

/// Turns of a round of trials and a breath, unless all are made.
const TURNS: usize = 2;

/// The same on small meshes.
const MORE_TURNS: usize = 5;

/// Rounds of trials before the results of cheaper jobs are mixed in, and the fewest where all are made.
const TRIALS: usize = 3;

/// Rounds of trials and breaths, at most.
const MOST_ROUNDS: usize = 60;

/// Rounds of trials and breaths have no more faces together than this, but [`TRIALS`] are made in any case.
const FACES_IN_ROUNDS: usize = 4_000_000;

/// Called with each change of the clusters: its kind, F after it, faces that moved, and their labels.
pub type OnChange<'a> = &'a mut dyn FnMut(Phase, LatticeEnergy, u64, &[u32]) -> Result<()>;

/// Computes the labels that cheaper jobs end with, one after the other.
pub type Cheaper<'a> = &'a mut dyn Iterator<Item = Result<Vec<u32>>>;

/// A relocation: what it works with.
pub struct Relocation<'a, E: Functional> {
    /// The faces.
    pub graph: &'a DualGraph<E>,
    /// Which steps are made.
    pub effort: Effort,
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
        cheaper: Cheaper<'_>,
        on_change: OnChange<'_>,
    ) -> Result<(Vec<u32>, Ending)> {
        if self.effort != Effort::All && self.no_swap_can_pay(&labels) {
            return Ok((labels, Ending::Converged));
        }
        let mut best = Improvable::new(self.graph, labels);
        let has_paid = self.swap(&mut best, on_change)?;
        let tries_more = self.tries_more(best.clusters.count(), has_paid);
        if tries_more && has_paid {
            let merged = merging::merged(self.graph, best.clusters.count(), self.pairs, device, self.cancel)?;
            self.mix_in_start(Phase::MergedStart, &mut best, merged, on_change)?;
        }
        if tries_more && self.effort == Effort::All {
            self.relax(&mut best, TRIALS, on_change)?;
        }
        if self.effort > Effort::Swaps {
            let fast = fast()?;
            let mut other = Improvable::new(self.graph, fast.clone());
            swap::swap(&mut other.clusters, &mut other.candidates, self.cancel, |_| Ok(()))?;
            self.mix_in(Phase::FastStart, &mut best, other, on_change)?;
            self.mix_in_start(Phase::SettledStart, &mut best, fast, on_change)?;
        }
        for labels in cheaper {
            let (phase, labels) = (Phase::OtherJob, labels?);
            match self.graph.moves {
                Moves::Free => self.mix_in(phase, &mut best, Improvable::new(self.graph, labels), on_change)?,
                // merges alone have not settled
                Moves::Connected => self.mix_in_start(phase, &mut best, labels, on_change)?,
            }
        }
        if tries_more {
            self.relax_and_breathe(&mut best, on_change)?;
        }
        Ok((best.clusters.compacted(), best.clusters.ending()))
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
        let mut best = Improvable::new(self.graph, labels);
        let has_paid = self.swap(&mut best, on_change)?;
        if self.tries_more(best.clusters.count(), has_paid) {
            if has_paid {
                self.mix_in_start(Phase::SettledStart, &mut best, flat()?, on_change)?;
            }
            self.relax_and_breathe(&mut best, on_change)?;
        }
        Ok(best.clusters.compacted())
    }

    /// Whether bounds show that no swap pays, and nothing else is worth it.
    fn no_swap_can_pay(&self, labels: &[u32]) -> bool {
        let clusters = labels.iter().max().map_or(0, |&last| last as usize + 1);
        // items that are no positions leave swaps that pay
        self.graph.moves == Moves::Free
            && !self.tries_more(clusters, false)
            && !gate::may_pay(self.graph, labels, clusters)
    }

    /// Whether trials and breaths are worth it.
    fn tries_more(&self, clusters: usize, has_paid: bool) -> bool {
        let is_small = self.is_small();
        match self.effort {
            Effort::Swaps => false,
            Effort::Some if is_small && clusters <= FEW_CLUSTERS => true,
            Effort::Some if is_small => has_paid || effective_faces(self.graph) < MANY_FACES * clusters,
            Effort::All if is_small => true,
            Effort::Some | Effort::All => has_paid || effective_faces(self.graph) < FEW_FACES * clusters,
        }
    }

    fn is_small(&self) -> bool {
        self.graph.faces() <= SMALL
    }

    /// Trials and breaths, in turns, or each as long as F falls.
    fn relax_and_breathe(&self, best: &mut Improvable<'a, E>, on_change: OnChange<'_>) -> Result<()> {
        let (turns, rounds, breaths) = match self.effort {
            Effort::All => (1, self.rounds(), self.rounds()),
            Effort::Some | Effort::Swaps => (if self.is_small() { MORE_TURNS } else { TURNS }, 1, 1),
        };
        let mut breath = Breath::default();
        for _ in 0..turns {
            self.relax(best, rounds, on_change)?;
            for _ in 0..breaths {
                if breath.lowers(best, self.cancel)? {
                    report(Phase::Breathe, &mut best.clusters, on_change)?;
                }
            }
        }
        Ok(())
    }

    /// Rounds of trials and breaths where all are made; fewer on large meshes.
    fn rounds(&self) -> usize {
        (FACES_IN_ROUNDS / self.graph.faces()).clamp(TRIALS, MOST_ROUNDS)
    }

    /// Swaps. Returns whether F has fallen by more than a thousandth.
    fn swap(&self, improvable: &mut Improvable<'_, E>, on_change: OnChange<'_>) -> Result<bool> {
        let before = improvable.clusters.energy().explained;
        swap::swap(&mut improvable.clusters, &mut improvable.candidates, self.cancel, |clusters| {
            report(Phase::Swap, clusters, on_change)
        })?;
        let fall = improvable.clusters.energy().explained - before;
        Ok(fall > 0 && fall > improvable.clusters.total() / 1000)
    }

    /// The lowest of two clusterings and their mix. `phase` names the second.
    fn mix_in(
        &self,
        phase: Phase,
        best: &mut Improvable<'a, E>,
        other: Improvable<'a, E>,
        on_change: OnChange<'_>,
    ) -> Result<()> {
        let wanted = best.clusters.count();
        let before = best.clusters.energy();
        let mut second = other;
        if second.clusters.energy() > before {
            std::mem::swap(best, &mut second);
        }
        best.candidates.refresh(&mut best.clusters);
        let cluster_worth = best.candidates.merges().first().map_or(0, |&(cost, ..)| cost);
        if let Some(labels) = mixed(&best.clusters, &second.clusters, cluster_worth) {
            let mut mix = Improvable::new(self.graph, labels);
            if resize(&mut mix.clusters, wanted, &mut mix.candidates, self.cancel)? {
                settle_and_swap(&mut mix.clusters, &mut mix.candidates, self.cancel)?;
                if mix.clusters.energy() > best.clusters.energy() {
                    *best = mix;
                }
            }
        }
        if best.clusters.energy() > before {
            report(phase, &mut best.clusters, on_change)?;
        }
        Ok(())
    }

    /// The same with another start, settled and after its own swaps.
    fn mix_in_start(
        &self,
        phase: Phase,
        best: &mut Improvable<'a, E>,
        labels: Vec<u32>,
        on_change: OnChange<'_>,
    ) -> Result<()> {
        let mut other = Improvable::new(self.graph, labels);
        settle_and_swap(&mut other.clusters, &mut other.candidates, self.cancel)?;
        self.mix_in(phase, best, other, on_change)
    }

    /// Rounds of trials, each followed by swaps, until one keeps none.
    fn relax(&self, improvable: &mut Improvable<'_, E>, rounds: usize, on_change: OnChange<'_>) -> Result<()> {
        for _ in 0..rounds {
            if trial::round(&mut improvable.clusters, &mut improvable.candidates, self.cancel)? == 0 {
                break;
            }
            report(Phase::Trial, &mut improvable.clusters, on_change)?;
            self.swap(improvable, on_change)?;
        }
        Ok(())
    }
}

/// A clustering, and what its clusters offer.
#[derive(Clone)]
struct Improvable<'a, E: Functional> {
    clusters: Clusters<'a, E>,
    candidates: Candidates,
}

impl<'a, E: Functional> Improvable<'a, E> {
    fn new(graph: &'a DualGraph<E>, labels: Vec<u32>) -> Self {
        Self { clusters: Clusters::new(graph, labels), candidates: Candidates::default() }
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
fn settle_and_swap<E: Functional>(
    clusters: &mut Clusters<'_, E>,
    candidates: &mut Candidates,
    cancel: &Cancel,
) -> Result<()> {
    let all = (0..clusters.numbers() as u32).collect();
    settle(clusters, all, u32::MAX, cancel)?;
    swap::swap(clusters, candidates, cancel, |_| Ok(()))
}

fn report<E: Functional>(phase: Phase, clusters: &mut Clusters<'_, E>, on_change: OnChange<'_>) -> Result<()> {
    let moves = clusters.take_moves();
    on_change(phase, clusters.energy(), moves, clusters.labels())
}

#[cfg(test)]
mod tests;
