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
//! it keeps most of its faces ([`super::numbers`]); all faces that are in another cluster than before count as moved.
//!
//! Rounds before the first that is optimised only merge. Where a device should not have memory for a cluster a face,
//! another makes them ([`Device::for_merges`]).
//!
//! Merging all pairs would halve the clusters also where they are large already; the next round moves what a few
//! iterations leave; clusters of two or three faces leave little to optimise (`benches/results/choices.md`).
//!
//! [`ONE_MERGED_IN`]: super::rounds::ONE_MERGED_IN
//! [`PAIRED_ROUNDS`]: super::merging::PAIRED_ROUNDS
//! [`Pairs`]: super::merging::Pairs
//! [`Quality`]: super::quality::Quality

use std::time::{Duration, Instant};

use super::rounds::Rounds;
pub use super::rounds::{Options, RoundRow};
use super::run::Row;
use super::seeds::check_number;
use crate::device::{Cancel, Device};
use crate::energy::Functional;
use crate::error::names::Name;
use crate::error::{Error, Result};
use crate::hierarchy::Tree;
use crate::surface::Items;

/// A hierarchy that was built.
#[derive(Debug)]
pub struct Hierarchy {
    /// The merges and moves.
    pub tree: Tree,
    /// Those of the last round, internal order.
    pub labels: Vec<u32>,
    /// The number of clusters at which sequential rounds reached their bound.
    pub bounded_at: Option<u64>,
    /// Time that the device took to open, and to get labels.
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
    let target = check(items, options)?;
    let mut rounds = Rounds::new(items, options, target, cancel, on_row, on_round);
    let mut labels: Vec<u32> = (0..items.faces() as u32).collect();
    let mut upload = Duration::ZERO;
    let mut for_merges = rounds.left_by_merges().and_then(|left| device.for_merges(items.faces() as u64, left));
    while !rounds.are_over() {
        // a device knows the component of each cluster, so it is opened anew when clusters have gone to others
        let component_of_cluster = rounds.component_of_cluster();
        let opened = Instant::now();
        let mut steps = device.open_merging(items, &component_of_cluster)?;
        upload += opened.elapsed();
        // after the device has taken the surface: one that does not fit is refused before the first round
        if let Some(mut other) = for_merges.take() {
            labels = rounds.until_optimised(other.open_merging(items, &component_of_cluster)?.as_mut(), &labels)?;
        }
        let opened = Instant::now();
        steps.set_labels(&labels)?;
        upload += opened.elapsed();
        labels = rounds.until_relocated(steps.as_mut())?;
    }
    let (tree, bounded_at) = rounds.end();
    Ok(Hierarchy { tree, labels, bounded_at, upload })
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
