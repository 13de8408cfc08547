//! Relocation: moves of whole clusters, which follow the phases of a flat clustering.
//!
//! The phases move single faces. Where faces are uneven, they end far above what the same number of clusters can reach:
//! each component keeps the clusters that its area gave it, light faces between heavy ones hold borders, and no single
//! move pays where a merge and a split at once would.
//!
//! # Definition
//!
//! | step | what | where |
//! |---|---|---|
//! | B | paying swaps: a merge and a split, until none pays | [`swap`], [`split`], [`mod@settle`] |
//! | C | another start, merged from single faces, with its own swaps | [`merging`] |
//! | D | a mix of both, each component from where it is cheaper | [`mix`], [`mod@resize`] |
//! | E | relaxed trials: merges and splits, judged after their surroundings have settled | [`trial`] |
//! | F | breathing: more clusters, then as many again | [`mod@breathe`] |
//!
//! C and D follow if swaps lowered F by a thousandth, E and F also where clusters have fewer than [`FEW_FACES`] faces.
//! The lowest of B, C and D goes on. Quality `fast` makes B; the default all, with [`TRIALS`] rounds of E and one
//! breath; `best` goes on as long as F falls, and mixes the result with that of another start. Meshes with fewer than
//! [`TINY`] faces get all of it. ([`super::coarse`] is step A.)
//!
//! On small even meshes the default makes E, without F, where there are more than [`WELL_STARTED`] clusters. Up to that
//! number the coarse start is the best of at least four, and E and F gain 0.3 % at most for half as much time again.
//!
//! # F never rises, and it ends
//!
//! Every step returns what it got, or something with a lower F. Swaps and trials lower F in each round; starts, mixes
//! and breaths are compared with what there is, and discarded unless they are lower. Every step keeps the number of
//! clusters, and each of them connected.
//!
//! Nothing depends on the device: the steps are exact integer arithmetic on the host. On even meshes B costs a pass
//! over the mesh and some splits, none of which pays, and nothing else is done.

mod breathe;
mod candidates;
mod clusters;
mod connection;
mod merging;
mod mix;
mod resize;
mod settle;
mod split;
mod swap;
mod trial;

use self::breathe::breathe;
use self::candidates::Candidates;
pub use self::clusters::Clusters;
use self::mix::mixed;
use self::resize::resize;
use self::settle::settle;
use super::run::Phase;
use crate::device::{Cancel, Device};
use crate::energy::LatticeEnergy;
use crate::error::Result;
use crate::surface::DualGraph;

/// Which steps are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effort {
    /// Swaps.
    Swaps,
    /// All steps, E and F a few times.
    Some,
    /// All steps, as long as F falls.
    All,
}

impl Effort {
    /// The effort on a mesh of this many faces: all on those with fewer than [`TINY`].
    pub fn on(self, faces: usize) -> Self {
        if faces < TINY { Effort::All } else { self }
    }
}

/// Clusters with fewer faces than this get E and F even if no swap pays.
const FEW_FACES: usize = 20;

/// Meshes with no more faces than this are small.
const SMALL: usize = 1 << 15;

/// Up to this number of clusters, a coarse start is the best of at least four.
const WELL_STARTED: usize = 200;

/// Meshes with fewer faces than this get all effort, whatever the quality.
const TINY: usize = 1_000;

/// Rounds of trials, unless all are made.
const TRIALS: usize = 3;

/// Rounds of trials and breaths, at most.
const MOST_ROUNDS: usize = 60;

/// Rounds of trials and breaths have no more faces together than this, but [`TRIALS`] are made in any case.
const FACES_IN_ROUNDS: usize = 4_000_000;

/// Called with each change of the clusters: its kind, F after it, faces that moved, and their labels.
pub type OnChange<'a> = &'a mut dyn FnMut(Phase, LatticeEnergy, u64, &[u32]) -> Result<()>;

/// Computes the labels of a further start, if there is one.
pub type Further<'a> = &'a dyn Fn(&mut dyn Device) -> Result<Option<Vec<u32>>>;

/// A relocation: what it works with.
pub struct Relocation<'a> {
    /// The faces.
    pub graph: &'a DualGraph,
    /// Merges single faces.
    pub device: &'a mut dyn Device,
    /// Ends it early.
    pub cancel: &'a Cancel,
}

impl<'a> Relocation<'a> {
    /// Makes the steps from labels in which every cluster has faces and is connected, and returns labels with as many
    /// clusters. `further` computes others with as many clusters, for effort [`Effort::All`] where it is worth it.
    pub fn labels(
        &mut self,
        labels: Vec<u32>,
        further: Further<'_>,
        effort: Effort,
        on_change: OnChange<'_>,
    ) -> Result<Vec<u32>> {
        let mut best = State::new(self.graph, labels);
        let has_paid = self.swap(&mut best, on_change)?;
        if effort == Effort::Swaps {
            return Ok(best.clusters.compacted());
        }
        let (faces, clusters) = (self.graph.faces(), best.clusters.count());
        let is_uneven = has_paid || faces < FEW_FACES * clusters;
        let is_small = faces <= SMALL && (effort == Effort::All || clusters > WELL_STARTED);
        if !is_uneven && !is_small {
            return Ok(best.clusters.compacted());
        }
        self.lower(&mut best, has_paid, on_change)?;
        if effort == Effort::All {
            if let Some(labels) = further(self.device)? {
                let mut other = State::new(self.graph, labels);
                let has_paid = self.swap(&mut other, &mut silent)?;
                self.lower(&mut other, has_paid, &mut silent)?;
                let other = breathe(other.clusters, 1, self.cancel, |_| Ok(()))?;
                self.mix_in(&mut best, State::new(self.graph, other.compacted()), on_change)?;
            }
            self.relax(&mut best, self.most_rounds(), on_change)?;
        }
        let breaths = if effort == Effort::All { self.most_rounds() } else { usize::from(is_uneven) };
        let on_lower = |clusters: &mut Clusters<'a>| report(Phase::Breathe, clusters, on_change);
        best.clusters = breathe(best.clusters, breaths, self.cancel, on_lower)?;
        Ok(best.clusters.compacted())
    }

    /// C, D and E; C and D if swaps have paid.
    fn lower(&mut self, best: &mut State<'a>, has_paid: bool, on_change: OnChange<'_>) -> Result<()> {
        let before = best.clusters.energy();
        settle_all(&mut best.clusters, self.cancel)?;
        if best.clusters.energy() > before {
            report(Phase::Refine, &mut best.clusters, on_change)?;
        }
        self.swap(best, on_change)?;
        if has_paid {
            let merged = merging::merged(self.graph, best.clusters.count(), self.device, self.cancel)?;
            let mut other = State::new(self.graph, merged);
            settle_and_swap(&mut other.clusters, &mut other.candidates, self.cancel)?;
            self.mix_in(best, other, on_change)?;
        }
        self.relax(best, TRIALS, on_change)
    }

    /// Rounds of trials, and breaths, with all effort: fewer on large meshes.
    fn most_rounds(&self) -> usize {
        (FACES_IN_ROUNDS / self.graph.faces()).clamp(TRIALS, MOST_ROUNDS)
    }

    /// B. Returns whether F has fallen by more than a thousandth.
    fn swap(&self, state: &mut State<'_>, on_change: OnChange<'_>) -> Result<bool> {
        let before = state.clusters.energy().explained;
        while swap::round(&mut state.clusters, &mut state.candidates, self.cancel)? > 0 {
            report(Phase::Swap, &mut state.clusters, on_change)?;
        }
        let fall = state.clusters.energy().explained - before;
        Ok(fall > 0 && fall > state.clusters.total() / 1000)
    }

    /// D: the lowest of two clusterings and their mix.
    fn mix_in(&self, best: &mut State<'a>, other: State<'a>, on_change: OnChange<'_>) -> Result<()> {
        let wanted = best.clusters.count();
        let before = best.clusters.energy();
        let mut second = other;
        if second.clusters.energy() > before {
            std::mem::swap(best, &mut second);
        }
        best.candidates.refresh(&mut best.clusters);
        let cluster_worth = best.candidates.merges().first().map_or(0, |&(cost, ..)| cost);
        if let Some(labels) = mixed(&best.clusters, &second.clusters, cluster_worth) {
            let mut mix = State::new(self.graph, labels);
            resize(&mut mix.clusters, wanted, &mut mix.candidates, self.cancel)?;
            settle_and_swap(&mut mix.clusters, &mut mix.candidates, self.cancel)?;
            if mix.clusters.energy() > best.clusters.energy() {
                *best = mix;
            }
        }
        if best.clusters.energy() > before {
            report(Phase::Restart, &mut best.clusters, on_change)?;
        }
        Ok(())
    }

    /// E: rounds of trials, each followed by swaps, until one keeps none.
    fn relax(&self, state: &mut State<'_>, rounds: usize, on_change: OnChange<'_>) -> Result<()> {
        for _ in 0..rounds {
            if trial::round(&mut state.clusters, &mut state.candidates, self.cancel)? == 0 {
                break;
            }
            report(Phase::Trial, &mut state.clusters, on_change)?;
            self.swap(state, on_change)?;
        }
        Ok(())
    }
}

/// A clustering, and what its clusters offer.
struct State<'a> {
    clusters: Clusters<'a>,
    candidates: Candidates,
}

impl<'a> State<'a> {
    fn new(graph: &'a DualGraph, labels: Vec<u32>) -> Self {
        Self { clusters: Clusters::new(graph, labels), candidates: Candidates::default() }
    }
}

fn settle_all(clusters: &mut Clusters<'_>, cancel: &Cancel) -> Result<()> {
    let all = (0..clusters.numbers() as u32).collect();
    settle(clusters, all, u32::MAX, cancel)
}

/// Settles all clusters, and makes swaps until none pays.
fn settle_and_swap(clusters: &mut Clusters<'_>, candidates: &mut Candidates, cancel: &Cancel) -> Result<()> {
    settle_all(clusters, cancel)?;
    while swap::round(clusters, candidates, cancel)? > 0 {}
    Ok(())
}

fn report(phase: Phase, clusters: &mut Clusters<'_>, on_change: OnChange<'_>) -> Result<()> {
    let moves = clusters.take_moves();
    on_change(phase, clusters.energy(), moves, clusters.labels())
}

/// Reports nothing.
fn silent(_: Phase, _: LatticeEnergy, _: u64, _: &[u32]) -> Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests;
