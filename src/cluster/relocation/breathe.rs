//! Breathing: more clusters than wanted, then as many again.
//!
//! # Definition
//!
//! With f = 1/5 at first, clusters are split until there are (1 + f)·k, and merged until there are k
//! ([`mod@super::resize`]); they settle, and swaps are made as long as they pay. If F is lower, the result is kept;
//! otherwise, or where rounds did not suffice, it is discarded and f is halved. Where F is lower by less than a
//! thousandth, f is multiplied by 0.7. It ends when f·k is less than 1.
//!
//! # Why
//!
//! A light face between heavy ones must be parted from one and joined to another before either pays; neither swaps nor
//! trials do both. Splits at f·k places, which settle before the merges choose, do.

use super::resize::resize;
use super::{Improvable, settle_and_swap};
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;

/// f, in units of 2⁻³².
const FIRST: u64 = (1 << 32) / 5;

/// How deep the next breath is: f.
pub struct Breath(u64);

impl Default for Breath {
    fn default() -> Self {
        Self(FIRST)
    }
}

impl Breath {
    /// Takes one, and keeps the result if that lowers F. Returns whether it does.
    pub fn lowers<E: Functional>(&mut self, best: &mut Improvable<'_, E>, cancel: &Cancel) -> Result<bool> {
        let (faces, wanted) = (best.clusters.graph.faces(), best.clusters.count());
        let more = ((u128::from(self.0) * wanted as u128) >> 32) as usize;
        if more == 0 {
            return Ok(false);
        }
        let mut breath = best.clone();
        let Improvable { clusters, candidates } = &mut breath;
        let is_done = resize(clusters, (wanted + more).min(faces), candidates, cancel)?
            && resize(clusters, wanted, candidates, cancel)?;
        if is_done {
            settle_and_swap(clusters, candidates, cancel)?;
        }
        let fall = clusters.energy().explained - best.clusters.energy().explained;
        if !is_done || fall <= 0 {
            self.0 /= 2;
            return Ok(false);
        }
        if fall < clusters.total() / 1000 {
            self.0 = self.0 * 7 / 10;
        }
        *best = breath;
        Ok(true)
    }
}
