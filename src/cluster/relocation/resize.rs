//! More clusters by splits, fewer by merges.
//!
//! A round splits the clusters that gain most, or merges the cheaper half of the mutual pairs, but no more than a
//! quarter of the clusters; then a few passes [settle](mod@crate::cluster::connected::settle) what changed. Splits in a
//! round gain at least a quarter of what the best gains: the parts of a large cluster are better split again than a
//! small one.
//!
//! There are at most [`ROUNDS`]. A cluster is split once a round, so that one with nearly all faces, as a large polygon
//! with a triangle at each edge, would take as many rounds as there are clusters to make.

use super::offers::Offers;
use crate::cluster::connected::settle::settle;
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;

/// Rounds at most.
const ROUNDS: u32 = 32;

/// Passes that settle a round.
const PASSES: u32 = 4;

/// Makes it this many clusters; no fewer than components, no more than faces. Returns whether rounds sufficed.
pub fn resize<E: Functional>(offers: &mut Offers<'_, E>, wanted: usize, cancel: &Cancel) -> Result<bool> {
    for _ in 0..ROUNDS {
        let count = offers.clusters.count();
        if count == wanted {
            return Ok(true);
        }
        let most = count.abs_diff(wanted).min(count.div_ceil(4));
        let changed = if count < wanted { split(offers, most) } else { merge(offers, most) };
        if changed.is_empty() {
            return Ok(false);
        }
        settle(&mut offers.clusters, changed, PASSES, cancel)?;
    }
    Ok(offers.clusters.count() == wanted)
}

/// Splits up to `most` clusters. Returns the parts.
fn split<E: Functional>(offers: &mut Offers<'_, E>, most: usize) -> Vec<u32> {
    let splits = offers.splits(|_, _| true);
    let Some(&(largest, _)) = splits.first() else { return Vec::new() };
    let mut parts = Vec::new();
    for &(_, cluster) in splits.iter().take(most).take_while(|&&(gain, _)| gain >= largest / 4) {
        parts.extend([cluster, offers.split(cluster)]);
    }
    parts
}

/// Merges the cheaper half of the mutual pairs, up to `most`. Returns what they became.
fn merge<E: Functional>(offers: &mut Offers<'_, E>, most: usize) -> Vec<u32> {
    let mut pairs = offers.merges();
    pairs.retain(|&(_, a, b)| offers.is_cheapest(b, a));
    pairs.truncate(pairs.len().div_ceil(2).min(most));
    pairs.into_iter().map(|(_, a, b)| offers.clusters.merge(a, b)).collect()
}
