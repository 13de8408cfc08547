//! Breathing: more clusters than wanted, then as many again.
//!
//! # Definition
//!
//! With f = 1/5 at first, clusters are split until there are (1 + f)·k, and merged until there are k
//! ([`mod@super::resize`]); they settle, and swaps are made as long as they pay. If F is lower, the result is kept;
//! otherwise it is discarded and f is halved. Where F is lower by less than a thousandth, f is multiplied by 0.7. It
//! ends when f·k is less than 1.
//!
//! # Why
//!
//! A light face between heavy ones must be parted from one and joined to another before either pays; neither swaps nor
//! trials do both. Splits at f·k places, which settle before the merges choose, do.

use super::candidates::Candidates;
use super::clusters::Clusters;
use super::resize::resize;
use super::settle_and_swap;
use crate::device::Cancel;
use crate::error::Result;

/// f, in units of 2⁻³².
const FIRST: u64 = (1 << 32) / 5;

/// Breathes until that lowers F no more, `most` times at most. `on_lower` is called with each result that is kept.
pub fn breathe<'a>(
    mut best: Clusters<'a>,
    most: usize,
    cancel: &Cancel,
    mut on_lower: impl FnMut(&mut Clusters<'a>) -> Result<()>,
) -> Result<Clusters<'a>> {
    let (faces, wanted) = (best.graph.faces(), best.count());
    let mut part = FIRST;
    for _ in 0..most {
        let more = ((u128::from(part) * wanted as u128) >> 32) as usize;
        if more == 0 {
            break;
        }
        let mut clusters = Clusters::new(best.graph, best.compacted());
        let mut candidates = Candidates::default();
        resize(&mut clusters, (wanted + more).min(faces), &mut candidates, cancel)?;
        resize(&mut clusters, wanted, &mut candidates, cancel)?;
        settle_and_swap(&mut clusters, &mut candidates, cancel)?;
        let fall = clusters.energy().explained - best.energy().explained;
        if fall > 0 {
            if fall < clusters.total() / 1000 {
                part = part * 7 / 10;
            }
            best = clusters;
            on_lower(&mut best)?;
        } else {
            part /= 2;
        }
    }
    Ok(best)
}
