//! Breathing: more clusters than wanted, then as many again.
//!
//! # Definition
//!
//! With f = 1/5 at first, clusters are split until there are (1 + f)·k, and merged until there are k
//! ([`mod@super::resize`]); they settle, and swaps are made as long as they pay. If F is lower, the result is kept;
//! otherwise, or where rounds did not suffice, it is discarded and f is halved. Where F is lower by less than a
//! thousandth, f is multiplied by 0.7. It ends when f·k is less than 1. On uneven meshes f is [`LEAST`]/k at first, if
//! that is more, but no more than 1.
//!
//! # Why
//!
//! A light face between heavy ones must be parted from one and joined to another before either pays; neither swaps nor
//! trials do both. Splits at f·k places, which settle before the merges choose, do.

use super::offers::Offers;
use super::resize::resize;
use super::settle_and_swap;
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;

/// f = 1, in units of 2⁻³².
const ONE: u64 = 1 << 32;

/// f at first, on even meshes.
const FIRST: u64 = ONE / 5;

/// Clusters that the first breath makes on uneven meshes, at least.
const LEAST: u64 = 20;

/// f at first, in the unit of [`ONE`].
pub fn first_depth(clusters: usize, is_uneven: bool) -> u64 {
    if is_uneven { (LEAST * ONE / clusters as u64).clamp(FIRST, ONE) } else { FIRST }
}

/// Takes a breath, and keeps the result if that lowers F. Returns whether it does. `depth` is f, of the next breath
/// then.
pub fn breathe<E: Functional>(best: &mut Offers<'_, E>, depth: &mut u64, cancel: &Cancel) -> Result<bool> {
    let (faces, wanted) = (best.clusters.graph.faces(), best.clusters.count());
    let more = ((u128::from(*depth) * wanted as u128) >> 32) as usize;
    if more == 0 {
        return Ok(false);
    }
    let mut breath = best.clone();
    let is_done = resize(&mut breath, (wanted + more).min(faces), cancel)? && resize(&mut breath, wanted, cancel)?;
    if is_done {
        settle_and_swap(&mut breath, cancel)?;
    }
    let fall = breath.clusters.energy().explained - best.clusters.energy().explained;
    if !is_done || fall <= 0 {
        *depth /= 2;
        return Ok(false);
    }
    if fall < breath.clusters.total() / 1000 {
        *depth = *depth * 7 / 10;
    }
    *best = breath;
    Ok(true)
}
