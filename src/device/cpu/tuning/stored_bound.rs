//! The bound of a face in 16 bytes, so that none lies in two cache lines: on large meshes the evaluation of faces waits
//! for memory (`benches/results/2026-11-22-two-cores/large.md`).

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::device::cpu::nearby::{Bound, NearClusters, saturated};

/// A [`Bound`]. The thread that evaluates a face stores it. A limit that needs more than 32 bits is lowered, so that it
/// is exceeded too early and never too late.
#[derive(Debug)]
#[repr(align(16))]
pub struct StoredBound {
    limit: AtomicU32,
    own: AtomicU32,
    others: [AtomicU32; 2],
}

/// In place of the limit: the face is active, and in the list of those that are.
const QUEUED: u32 = 0;

impl StoredBound {
    /// Of an active face.
    pub fn active() -> Self {
        Self { limit: (Bound::ACTIVE as u32).into(), own: 1.into(), others: [0.into(), 0.into()] }
    }

    /// Replaces the bound of a face.
    #[inline]
    pub fn store(&self, Bound { near: NearClusters { own, others: [first, second] }, limit }: Bound) {
        self.limit.store(saturated(limit), Relaxed);
        self.own.store(own, Relaxed);
        self.others[0].store(first, Relaxed);
        self.others[1].store(second, Relaxed);
    }

    /// Notes that the face is in the list of active faces. Returns whether it was not.
    #[inline]
    pub fn queue(&mut self) -> bool {
        std::mem::replace(self.limit.get_mut(), QUEUED) != QUEUED
    }

    /// Whether the face is in the list of active faces.
    #[inline]
    pub fn is_queued(&self) -> bool {
        self.limit.load(Relaxed) == QUEUED
    }

    /// Of a face that sees many clusters: how far its own proxy may drift if the others do not.
    #[inline]
    pub fn own_limit(&self) -> u64 {
        self.others[1].load(Relaxed).into()
    }

    /// Lowers that to at most `limit`.
    #[inline]
    pub fn lower_own_limit(&self, limit: u64) {
        self.others[1].fetch_min(saturated(limit), Relaxed);
    }

    /// The clusters that the face saw when it was evaluated.
    #[inline]
    pub fn near(&self) -> NearClusters {
        let [first, second] = &self.others;
        NearClusters { own: self.own.load(Relaxed), others: [first.load(Relaxed), second.load(Relaxed)] }
    }

    /// How far the proxies may drift; below any drift for an active face.
    #[inline]
    pub fn limit(&self) -> u64 {
        self.limit.load(Relaxed).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_is_stored_and_a_limit_is_never_raised() {
        let near = NearClusters { own: 3, others: [5, 9] };
        let mut stored = StoredBound::active();
        assert_eq!(stored.limit(), Bound::ACTIVE);
        for (limit, expected) in [(2, 2), (u32::MAX.into(), u32::MAX.into()), (1 << 32, u32::MAX.into())] {
            stored.store(Bound { near, limit });
            assert_eq!((stored.near(), stored.limit()), (near, expected));
            assert!(!stored.is_queued() && stored.queue() && !stored.queue());
            assert!(stored.is_queued());
        }
    }
}
