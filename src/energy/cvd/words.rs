//! Which words a face, the sums of a cluster and a proxy take on a gpu. `shaders/energy/cvd.wgsl` computes with them.

use super::{ClusterSums, Item};
use crate::energy::shared::{Vec3, shared};

/// The energy in WGSL.
pub const WGSL: &str = include_str!("../../../shaders/energy/cvd.wgsl");

shared! {
    /// A face as the energy sees it.
    Face {
        /// g, |g| < 2²⁷ an axis.
        centroid: Vec3,
        /// w, at least 1.
        weight: u32,
    }

    /// The proxy of a cluster.
    Proxy {
        /// P.
        position: Vec3,
        /// The cluster's energy is shifted left by this, at most 30, to the units of the finest component.
        energy_shift: u32,
    }
}

/// Numbers of 64 bits that the sums of a cluster are: S an axis each, and M.
pub const SUMS: usize = 4;

impl Proxy {
    /// That of a cluster without faces.
    pub fn unfitted(energy_shift: u32) -> Self {
        Self { position: [0; 3], energy_shift }
    }
}

impl From<Item<3>> for Face {
    fn from(Item { point, weight }: Item<3>) -> Self {
        Self { centroid: point, weight }
    }
}

impl ClusterSums<3> {
    /// The sums from their words, the low one of each number first.
    pub fn of_words(words: [u32; 2 * SUMS], faces: u32) -> Self {
        let number = |at: usize| (u64::from(words[2 * at + 1]) << 32 | u64::from(words[2 * at])).cast_signed();
        Self { centroid: std::array::from_fn(number), weight: number(3), faces }
    }
}
