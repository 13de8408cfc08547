//! More clusters by splits, fewer by merges.
//!
//! A round splits the clusters that gain most, or merges the cheaper half of the mutual pairs, but no more than a
//! quarter of the clusters; then a few passes [settle](mod@super::settle) what changed. Splits in a round gain at least
//! a quarter of what the best gains: the parts of a large cluster are better split again than a small one.
//!
//! There are at most [`ROUNDS`]. A cluster is split once a round, so that one with nearly all faces, as a large polygon
//! with a triangle at each edge, would take as many rounds as there are clusters to make.
//!
//! A split gains no more than its cluster's energy. So the clusters with the most energy are split first, and then only
//! those with more energy than the least gain that would be used.

use std::cmp::Reverse;

use super::candidates::Candidates;
use super::clusters::Clusters;
use super::settle::settle;
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;

/// Rounds at most. Ordinary meshes take two, slivers up to 21.
const ROUNDS: u32 = 32;

/// Passes that settle a round.
const PASSES: u32 = 4;

/// Makes it this many clusters; no fewer than components, no more than faces. Returns whether rounds sufficed.
pub fn resize<E: Functional>(
    clusters: &mut Clusters<'_, E>,
    wanted: usize,
    candidates: &mut Candidates,
    cancel: &Cancel,
) -> Result<bool> {
    for _ in 0..ROUNDS {
        let count = clusters.count();
        if count == wanted {
            return Ok(true);
        }
        let most = count.abs_diff(wanted).min(count.div_ceil(4));
        candidates.refresh(clusters);
        let changed = match count < wanted {
            true => split(clusters, most, candidates),
            false => merge(clusters, most, candidates),
        };
        if changed.is_empty() {
            return Ok(false);
        }
        settle(clusters, changed, PASSES, cancel)?;
    }
    Ok(clusters.count() == wanted)
}

/// Splits up to `most` clusters. Returns the parts.
fn split<E: Functional>(clusters: &mut Clusters<'_, E>, most: usize, candidates: &mut Candidates) -> Vec<u32> {
    let numbers = 0..clusters.numbers() as u32;
    let mut by_energy: Vec<u32> = numbers.filter(|&cluster| clusters.faces(cluster).len() > 1).collect();
    by_energy.sort_unstable_by_key(|&cluster| (Reverse(clusters.energy_of(cluster)), cluster));
    let mut is_wanted = vec![false; clusters.numbers()];
    by_energy.iter().take(most).for_each(|&cluster| is_wanted[cluster as usize] = true);
    candidates.split(clusters, |cluster| is_wanted[cluster as usize]);
    let least = candidates.splits().get(most - 1).map_or(-1, |&(gain, _)| gain);
    for &cluster in &by_energy {
        is_wanted[cluster as usize] |= clusters.may_gain(least, cluster);
    }
    candidates.split(clusters, |cluster| is_wanted[cluster as usize]);
    let splits = candidates.splits();
    let Some(&(largest, _)) = splits.first() else { return Vec::new() };
    let mut parts = Vec::new();
    for &(_, cluster) in splits.iter().take(most).take_while(|&&(gain, _)| gain >= largest / 4) {
        let leaving = candidates.known_split(cluster).map_or(&[][..], |split| &split.leaving);
        parts.extend([cluster, clusters.split(cluster, leaving)]);
    }
    parts
}

/// Merges the cheaper half of the mutual pairs, up to `most`. Returns what they became.
fn merge<E: Functional>(clusters: &mut Clusters<'_, E>, most: usize, candidates: &Candidates) -> Vec<u32> {
    let mut pairs = candidates.merges();
    pairs.retain(|&(_, a, b)| candidates.merge(b).is_some_and(|back| back.other == a));
    pairs.truncate(pairs.len().div_ceil(2).min(most));
    pairs.into_iter().map(|(_, a, b)| clusters.merge(a, b)).collect()
}
