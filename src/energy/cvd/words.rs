//! Which words a face, the sums of a cluster and a proxy take on a gpu. `shaders/energy/cvd.wgsl` computes with them.

use super::{ClusterSums, Cvd};
use crate::energy::functional::Item;
use crate::energy::shared::{Words, wide};

/// The energy in WGSL.
pub const WGSL: &str = include_str!("../../../shaders/energy/cvd.wgsl");

wide! {
    /// A face as the energy sees it.
    FACE = Face(|axes| axes + 1) {
        /// g.
        point: Point,
        /// w, at least 1.
        weight: u32,
    }

    /// The proxy of a cluster.
    PROXY = Proxy(|axes| axes + 1) {
        /// P.
        position: Point,
        /// The cluster's energy is shifted left by this, at most 30, to the units of the finest component.
        energy_shift: u32,
    }
}

/// Numbers of 64 bits that the sums of a cluster are: S an axis each, and M.
pub const fn sums(axes: usize) -> usize {
    axes + 1
}

impl<const D: usize> Words for Cvd<D> {
    const AXES: usize = D;

    fn point(coordinate: impl FnMut(usize) -> i32) -> [i32; D] {
        std::array::from_fn(coordinate)
    }

    fn of_face(Item { point, weight }: Item<[i32; D]>) -> impl Iterator<Item = u32> {
        point.map(i32::cast_unsigned).into_iter().chain([weight])
    }

    fn of_unfitted(energy_shift: u32) -> impl Iterator<Item = u32> {
        [0; D].into_iter().chain([energy_shift])
    }

    fn sums(words: &[u32], faces: u32) -> ClusterSums<D> {
        let number = |at: usize| (u64::from(words[2 * at + 1]) << 32 | u64::from(words[2 * at])).cast_signed();
        ClusterSums { centroid: std::array::from_fn(number), weight: number(D), faces }
    }
}
