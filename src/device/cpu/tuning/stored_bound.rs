//! The bound of a face in 16 bytes, so that none lies in two cache lines: on large meshes the evaluation of faces waits
//! for memory (`benches/results/2026-11-22-two-cores/large.md`).
//!
//! The limit has 32 bits where the face sees at most two other clusters, and 62 where it sees more.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::device::cpu::nearby::{Bound, MANY, NearClusters};

/// A [`Bound`], packed. The thread that evaluates a face stores its bound.
#[derive(Debug)]
#[repr(align(16))]
pub struct StoredBound {
    /// [`QUEUED`]; or the limit, of which only the lower [`LOWER_BITS`] bits are here, below a 1, where the others are
    /// [`MANY`] and the face is not active.
    limit: AtomicU32,
    own: AtomicU32,
    /// As in [`NearClusters`]; after [`MANY`] come the upper bits of the limit.
    others: [AtomicU32; 2],
}

/// In place of the limit: the face is active, and in the list of those that are.
const QUEUED: u32 = 0;

/// Bits of a limit below the 1 that tells it from [`QUEUED`] and from that of an active face.
const LOWER_BITS: u32 = 31;

impl StoredBound {
    /// Of an active face.
    pub fn active() -> Self {
        Self { limit: (Bound::ACTIVE as u32).into(), own: 1.into(), others: [0.into(), 0.into()] }
    }

    /// Replaces the bound of a face.
    #[inline]
    pub fn store(&self, Bound { near: NearClusters { own, others }, limit }: Bound) {
        let (lower, second) = match others {
            [MANY, _] if limit > Bound::ACTIVE => (limit as u32 | 1 << LOWER_BITS, (limit >> LOWER_BITS) as u32),
            [_, second] => (u32::try_from(limit).unwrap_or(u32::MAX), second),
        };
        self.limit.store(lower, Relaxed);
        self.own.store(own, Relaxed);
        self.others[0].store(others[0], Relaxed);
        self.others[1].store(second, Relaxed);
    }

    /// Notes that the face is in the list of active faces. Returns whether it was not.
    #[inline]
    pub fn queue(&mut self) -> bool {
        std::mem::replace(self.limit.get_mut(), QUEUED) != QUEUED
    }

    /// The clusters that the face saw when it was evaluated. After [`MANY`] comes any number.
    #[inline]
    pub fn near(&self) -> NearClusters {
        let [first, second] = &self.others;
        NearClusters { own: self.own.load(Relaxed), others: [first.load(Relaxed), second.load(Relaxed)] }
    }

    /// How far the proxies may drift; below any drift for an active face.
    #[inline]
    pub fn limit(&self) -> u64 {
        let limit = self.limit.load(Relaxed);
        match self.near().others {
            [MANY, upper] if u64::from(limit) > Bound::ACTIVE => {
                u64::from(upper) << LOWER_BITS | u64::from(limit & !(1 << LOWER_BITS))
            }
            _ => limit.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_and_clusters_are_stored_exactly() {
        for limit in [2, 3, (1 << 31) - 1, 1 << 31, (1 << 31) + 1, (1 << 32) - 2, 1 << 32, (1 << 40) + 7] {
            for others in [[MANY, 0], [5, 9], [5, 0], [0, 0]] {
                let mut stored = StoredBound::active();
                stored.store(Bound { near: NearClusters { own: 3, others }, limit });
                assert_eq!(stored.near().own, 3);
                assert_eq!(stored.near().others[0], others[0]);
                if others[0] == MANY {
                    assert_eq!(stored.limit(), limit);
                } else {
                    assert_eq!(stored.near().others, others);
                    assert_eq!(stored.limit(), limit.min(u32::MAX.into()));
                }
                stored.store(Bound { near: NearClusters { own: 3, others }, limit: Bound::ACTIVE });
                assert_eq!(stored.limit(), Bound::ACTIVE);
                assert!(stored.queue() && !stored.queue());
                assert_eq!(stored.limit(), u64::from(QUEUED));
            }
        }
    }
}
