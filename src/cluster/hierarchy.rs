//! Hierarchical clustering: parallel multilevel (PML), multilevel (ML) and without optimisation (P§4, P§5.4).
//!
//! # Definition
//!
//! Every face starts as a cluster. A round merges clusters and then optimises:
//!
//! * *Parallel rounds* (PML): every cluster finds its best dual edge ([`crate::device::dual_edge`]: packed cost, then
//!   the tie rule); of the pairs that chose each other, those that cost no more than their median merge, or, as in the
//!   paper, all ([`Pairs`]), all at once. The edges are totally ordered (or, with the paper's tie rule, the cluster
//!   with the largest number among those of the cheapest edges has a partner that chose it back), so there is always
//!   such a pair while a dual edge is left.
//! * *Sequential rounds* (ML): the dual edge with the smallest exact cost of all merges; with `collapse_fraction` P,
//!   one after the other until P % of the clusters are gone (Chiosa & Kolb 2008).
//! * *Optimisation*: the boundary phase and the refinement of [`super::flat`], on the merged clusters. Between stops,
//!   parallel rounds make only a few iterations (2), and the next round goes on where they ended. Then pieces that were
//!   cut off are given to their neighbours. Parallel rounds are optimised when clusters have 4 faces on average
//!   ([`Options::optimised_from`]), stops always. Both numbers are those of the default [`super::quality::Quality`].
//!
//! Of two clusters that merge, the one with more faces keeps its number, the smaller number of equal ones. Clusters
//! start with the internal number of their face.
//!
//! Without optimisation no face ever moves, and the tree is nested: parallel hierarchical clustering, or with
//! sequential rounds exact greedy Ward clustering on the lattice (Garland et al. 2001).
//!
//! A run stops at `clusters`, at each of `levels` and at one cluster a component, at exactly those numbers: a round
//! that would pass one merges only its cheapest pairs. There the phases run until no cluster is in pieces, as in a flat
//! run.
//!
//! Why the cheaper half: merging all pairs halves the clusters everywhere, also where they are large already. Why a few
//! iterations: the next round moves what a minimum would fix. Why not from the first round: clusters of two or three
//! faces leave little to optimise. `benches/results/choices.md` has the measurements.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::run::{Row, Run};
use super::seeds::check_number;
use crate::device::dual_edge::{Rank, Ties, keep_cheaper_half};
use crate::device::{Cancel, MergeSteps};
use crate::energy::{ClusterSums, LatticeEnergy};
use crate::error::names::Name;
use crate::error::{Error, Kind, Result};
use crate::hierarchy::{FaceMove, Merge, Round, Tree};
use crate::surface::Surface;

/// Which of the pairs of clusters that chose each other merge in a parallel round.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pairs {
    /// Those that cost no more than their median
    #[default]
    CheaperHalf,
    /// All of them, as the paper does (Parallel Mesh Clustering, section 5.4)
    All,
}

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
}

/// What a round did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoundRow {
    /// Number of the round, from 1.
    pub round: u32,
    /// Clusters left after it.
    pub clusters: u64,
    /// Energy after it.
    pub energy: LatticeEnergy,
    /// Pairs that merged.
    pub merges: u64,
    /// Faces that belong elsewhere after the optimisation than after the merges.
    pub moves: u64,
    /// Whether it ended at a requested number of clusters.
    pub is_level: bool,
}

/// Builds a hierarchy. The device was opened for it with one cluster a face, in the component of that face.
///
/// `on_row` is called with every iteration of parallel rounds, `on_round` with every round. Labels are the last
/// round's, internal order.
pub fn hierarchical(
    surface: &Surface,
    options: &Options,
    steps: &mut dyn MergeSteps,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
    on_round: &mut dyn FnMut(RoundRow),
) -> Result<(Tree, Vec<u32>)> {
    let (faces, components) = (surface.faces() as u64, surface.components.len() as u64);
    let target = check(surface, options)?;
    steps.set_labels(&(0..faces as u32).collect::<Vec<_>>())?;
    let mut builder = Builder::new(surface, (faces - target) as usize);
    let mut iteration = 0;
    let mut left = faces;
    while left > target {
        cancel.check()?;
        let round = builder.tree.rounds.len() as u32 + 1;
        let stop = options.levels.iter().copied().filter(|&level| level < left).fold(target, u64::max);
        let is_sequential = left <= options.sequential_at;
        let merges = if is_sequential {
            let wanted = options.collapse_fraction.map_or(1, |percent| (left as f64 * percent / 100.0) as u64);
            merge_cheapest(steps, options.ties, wanted.clamp(1, left - stop), &mut builder)?
        } else {
            merge_mutual(steps, options, left - stop, &mut builder)?
        };
        left -= merges;
        let is_level = left == stop && (options.levels.contains(&stop) || options.clusters == Some(stop));
        let mut moves = 0;
        // a cluster that is all of its component does not count
        let are_large = faces >= options.optimised_from * (left - components);
        if options.optimise && (is_level || is_sequential || are_large) {
            let on_row: &mut dyn FnMut(Row) = if is_sequential && !is_level { &mut |_| {} } else { on_row };
            let (round, left, record, has_flooded) = (Some(round), u32::MAX, None, false);
            let mut run = Run { steps, cancel, on_row, round, iteration, left, record, has_flooded };
            optimise(&mut run, options, is_level, is_sequential)?;
            iteration = run.iteration;
            let moved = steps.moves_since_merge()?;
            moves = moved.len() as u64;
            builder.moves(&moved);
        }
        let energy = steps.energy()?;
        builder.end_round(left, energy);
        on_round(RoundRow { round, clusters: left, energy, merges, moves, is_level });
    }
    Ok((builder.tree, steps.labels()?))
}

/// Where to end. Refuses numbers that this surface cannot have.
pub fn check(surface: &Surface, options: &Options) -> Result<u64> {
    options.clusters.iter().try_for_each(|&number| check_number(surface, Name::CLUSTERS, number))?;
    options.levels.iter().try_for_each(|&number| check_number(surface, Name::LEVELS, number))?;
    let target = options.clusters.unwrap_or(surface.components.len() as u64);
    if let Some(level) = options.levels.iter().find(|&&level| level < target) {
        return Err(Error::parameter(format_args!(
            "{} must not be below {}, {target}: {level}",
            Name::LEVELS,
            Name::CLUSTERS
        )));
    }
    Ok(target)
}

/// Merges mutual pairs, the cheapest first, `at_most` of them; returns how many.
fn merge_mutual(steps: &mut dyn MergeSteps, options: &Options, at_most: u64, builder: &mut Builder<'_>) -> Result<u64> {
    let mut mutual = steps.mutual_dual_edges(options.ties)?;
    if mutual.is_empty() {
        return Err(Error::new(Kind::Internal, "no two clusters chose each other"));
    }
    if options.pairs == Pairs::CheaperHalf {
        keep_cheaper_half(&mut mutual);
    }
    mutual.par_sort_unstable();
    mutual.truncate(at_most as usize);
    let pairs: Vec<(u32, u32)> = mutual.iter().map(Rank::ends).collect();
    merge(steps, &pairs, builder)?;
    Ok(pairs.len() as u64)
}

/// Merges the cheapest dual edge of all, `times` times; returns that number.
fn merge_cheapest(steps: &mut dyn MergeSteps, ties: Ties, times: u64, builder: &mut Builder<'_>) -> Result<u64> {
    for _ in 0..times {
        let pair = steps.cheapest_dual_edge(ties)?;
        let pair = pair.ok_or_else(|| Error::new(Kind::Internal, "there is no dual edge left to collapse"))?;
        merge(steps, &[pair], builder)?;
    }
    Ok(times)
}

/// Merges pairs and records them.
fn merge(steps: &mut dyn MergeSteps, pairs: &[(u32, u32)], builder: &mut Builder<'_>) -> Result<()> {
    let (ordered, sums) = steps.merge_pairs(pairs)?;
    builder.merge(&ordered, sums.as_chunks().0);
    Ok(())
}

/// The phases after the merges of a round.
fn optimise(run: &mut Run<'_>, options: &Options, is_level: bool, is_sequential: bool) -> Result<()> {
    run.left = if is_level { u32::MAX } else { options.iterations_a_round[usize::from(is_sequential)] };
    if is_level {
        run.complete(options.allow_disconnected, |run| run.optimise(options.refine))?;
        return Ok(());
    }
    run.optimise(options.refine)?;
    if !options.allow_disconnected {
        run.repair()?;
    }
    Ok(())
}

/// Merges that a thread records at a time.
const MERGES_A_THREAD: usize = 256;

/// Builds the tree of a run.
struct Builder<'a> {
    surface: &'a Surface,
    tree: Tree,
    /// Σ w·|g|² of each cluster, exactly.
    moments: Vec<i128>,
}

impl<'a> Builder<'a> {
    /// An empty tree with room for `merges` merges.
    fn new(surface: &'a Surface, merges: usize) -> Self {
        let faces = surface.faces() as u32;
        let moments = (0..faces).map(|face| surface.moment_of(face)).collect();
        Self { surface, tree: Tree { faces, merges: Vec::with_capacity(merges), ..Tree::default() }, moments }
    }

    /// Records merges (from, into), with the sums of both ends before, in either order.
    fn merge(&mut self, pairs: &[(u32, u32)], sums: &[[ClusterSums; 2]]) {
        for &(from, into) in pairs {
            self.moments[into as usize] += std::mem::take(&mut self.moments[from as usize]);
        }
        let Self { surface, tree, moments } = self;
        let records = pairs.par_iter().zip(sums).with_min_len(MERGES_A_THREAD).map(|(&(from, into), [a, b])| {
            let made = surface.merged(a, b, moments[into as usize], into);
            let [into, from] = [into, from].map(|cluster| surface.upload_face[cluster as usize]);
            Merge { into, from, made }
        });
        tree.merges.par_extend(records);
    }

    /// Records moves: (face, from, to).
    fn moves(&mut self, moves: &[(u32, u32, u32)]) {
        let upload = &self.surface.upload_face;
        for &(face, from, to) in moves {
            let moment = self.surface.moment_of(face);
            self.moments[from as usize] -= moment;
            self.moments[to as usize] += moment;
            self.tree.moves.push(FaceMove { face: upload[face as usize], to: upload[to as usize] });
        }
    }

    fn end_round(&mut self, clusters: u64, energy: LatticeEnergy) {
        self.tree.rounds.push(Round {
            clusters: clusters as u32,
            energy: self.surface.energy(energy),
            merges_end: self.tree.merges.len() as u32,
            moves_end: self.tree.moves.len() as u64,
        });
    }
}
