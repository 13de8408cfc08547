//! Structs that Rust and WGSL share, byte for byte. `tests/shader_layout.rs` compares [`STRUCTS`] with what the shaders
//! declare.

use std::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

use crate::energy::ClusterSums;

/// Threads in a workgroup of every kernel that has one thread an item.
pub const WORKGROUP: u32 = 256;

/// Faces that one thread takes in kernels with [`Threads::FaceRuns`](super::kernels::Threads::FaceRuns).
pub const RUN: u32 = 8;

/// `label_at_merge` of a face that is not on the boundary list.
pub const UNLISTED: u32 = u32::MAX - 1;

/// [`Iteration::ties`] for [`Ties::Hash`](crate::device::dual_edge::Ties::Hash).
pub const TIES_BY_HASH: u32 = 0;

/// [`Iteration::ties`] for [`Ties::LargestId`](crate::device::dual_edge::Ties::LargestId).
pub const TIES_BY_LARGEST_ID: u32 = 1;

/// A struct that WGSL declares too.
#[derive(Debug, Clone, Copy)]
pub struct Struct {
    /// Its name in WGSL.
    pub name: &'static str,
    /// Size in bytes.
    pub size: usize,
    /// Names and offsets of its members, padding included where WGSL names it as a member.
    pub members: &'static [(&'static str, usize)],
}

/// Defines the structs and lists them in [`STRUCTS`].
macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident { $($(#[$member_doc:meta])* $member:ident: $type:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
            #[repr(C)]
            pub struct $name { $($(#[$member_doc])* pub $member: $type,)* }
        )*

        /// All structs that both sides declare.
        pub const STRUCTS: &[Struct] = &[$(Struct {
            name: stringify!($name),
            size: size_of::<$name>(),
            members: &[$((stringify!($member), offset_of!($name, $member))),*],
        }),*];
    };
}

shared! {
    /// A uniform: an iteration of a phase, or a pass of the growth.
    Iteration {
        /// Index of its entry in the statistics.
        slot: u32,
        /// 1: outside a batch of iterations. Kernels then do their work even though nothing moved.
        between: u32,
        /// Number of faces.
        faces: u32,
        /// Number of clusters that are left.
        clusters: u32,
        /// Workgroups in a full row of a dispatch.
        row: u32,
        /// Number of the iteration in its phase, from 1.
        number: u32,
        /// Number of entries of the list that the host wrote.
        entries: u32,
        /// Order of equally cheap dual edges: [`TIES_BY_HASH`] or [`TIES_BY_LARGEST_ID`]. The size of a uniform must be
        /// a multiple of 16 bytes.
        ties: u32,
    }

    /// What an iteration reports to the host.
    IterationStats {
        /// Three 64-bit sums of weight 1, 2³² and 2⁶⁴, low word first.
        explained: [u32; 6],
        /// Faces whose label changed.
        moves: u32,
        /// Faces that bid, in refinement.
        bids: u32,
    }

    /// A face.
    Face {
        /// In lattice units.
        centroid: [i32; 3],
        /// In units of its component.
        weight: u32,
    }

    /// A proxy.
    Proxy {
        /// In lattice units.
        position: [i32; 3],
        /// Shift of the cluster's energy to the units of the finest component.
        energy_shift: u32,
    }

    /// Sums of a cluster. The host only clears it.
    Cluster {
        /// Σ weight·centroid: 64 bits an axis, low word first.
        moment: [u32; 6],
        /// Σ weight, low word first.
        weight: [u32; 2],
        /// Number of faces.
        count: u32,
        /// Faces that do not want to leave in this iteration.
        staying: u32,
        /// Smallest face that wants to leave.
        first_leaver: u32,
        /// Whether it is known to be connected.
        connected: u32,
    }

    /// The best move of a face, in refinement.
    FaceBid {
        /// The cluster that it wants to enter.
        cluster: u32,
        /// Its packed gain.
        bid: u32,
        /// The iteration in which it was last refused.
        refused_in: u32,
    }

    /// The bids at a cluster, and the move that leaves it.
    ClusterBids {
        /// The largest packed gain.
        best_bid: u32,
        /// The smallest face with that gain.
        best_face: u32,
        /// The iteration in which a face last won a move out of the cluster.
        won_in: u32,
        /// That face.
        winner: u32,
        /// The cluster that it wants to enter.
        target_cluster: u32,
        /// What was decided.
        accepted: u32,
        /// The iteration in which the cluster last gained or lost a face.
        changed_in: u32,
        /// Padding.
        unused: u32,
    }

    /// The piece that a cluster keeps.
    LargestPiece {
        /// Number of its faces.
        size: u32,
        /// Its smallest face, inverted.
        inverted_root: u32,
    }

    /// What dispatches go over. The host writes the clusters.
    BoundaryList {
        /// Listed faces.
        length: u32,
        /// Faces that have been kept so far.
        kept: u32,
        /// Listed faces that dispatches go over.
        due: u32,
        /// Index in the entries of the first of them.
        first: u32,
        /// The first of two entries a face and one a cluster.
        entries: [u32; 1],
    }

    /// The best dual edge of a cluster so far, all numbers inverted.
    BestDualEdge {
        /// The packed cost.
        cost: u32,
        /// The tie.
        tie: u32,
        /// The neighbour.
        other: u32,
    }

    /// The best dual edge of a cluster, for the host.
    DualEdge {
        /// The neighbour; [`FREE`](crate::device::FREE) without an edge.
        other: u32,
        /// The packed cost.
        cost: u32,
    }

    /// The best dual edge of a workgroup.
    CandidateEdge {
        /// The exact cost in units of the finest component, low word first.
        cost: [u32; 4],
        /// The tie.
        tie: u32,
        /// The end with the smaller number; [`FREE`](crate::device::FREE) where there is no edge.
        low: u32,
        /// The other end.
        high: u32,
        /// Padding.
        unused: u32,
    }

    /// A face that belongs to another cluster than after the last merge.
    Move {
        /// The face.
        face: u32,
        /// Its cluster after the merge.
        before: u32,
        /// Its cluster now.
        after: u32,
    }

    /// The sums of a cluster, for the host.
    CopiedSums {
        /// Σ weight·centroid: 64 bits an axis, low word first.
        moment: [u32; 6],
        /// Σ weight, low word first.
        weight: [u32; 2],
        /// Number of faces.
        count: u32,
    }
}

/// Workgroups of a dispatch.
pub type Dispatch = [u32; 3];

impl IterationStats {
    /// The explained energy; in refinement, its rise. The device adds modulo 2¹²⁸ in two's complement, and the true
    /// value fits.
    pub fn explained(&self) -> i128 {
        let limb = |at: usize| u128::from(self.explained[2 * at]) | u128::from(self.explained[2 * at + 1]) << 32;
        let sum = limb(0).wrapping_add(limb(1) << 32).wrapping_add(limb(2) << 64);
        sum.cast_signed()
    }
}

impl CopiedSums {
    /// The same for the host.
    pub fn sums(&self) -> ClusterSums {
        let number = |low: u32, high: u32| (u64::from(high) << 32 | u64::from(low)).cast_signed();
        ClusterSums {
            centroid: std::array::from_fn(|axis| number(self.moment[2 * axis], self.moment[2 * axis + 1])),
            weight: number(self.weight[0], self.weight[1]),
            faces: self.count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The statistics of a device that adds the limbs of `values` one by one.
    fn stats_of(values: &[i128]) -> IterationStats {
        let mut limbs = [0u64; 3];
        for value in values {
            let bits = value.cast_unsigned();
            limbs[0] = limbs[0].wrapping_add(bits as u32 as u64);
            limbs[1] = limbs[1].wrapping_add((bits >> 32) as u32 as u64);
            limbs[2] = limbs[2].wrapping_add((bits >> 64) as u64);
        }
        let mut explained = [0; 6];
        for (at, limb) in limbs.into_iter().enumerate() {
            explained[2 * at] = limb as u32;
            explained[2 * at + 1] = (limb >> 32) as u32;
        }
        IterationStats { explained, moves: 0, bids: 0 }
    }

    #[test]
    fn the_host_assembles_negative_and_large_energies() {
        let large = (1i128 << 122) + 12_345_678_901_234_567_890;
        for values in [
            vec![0],
            vec![-1],
            vec![large],
            vec![-large],
            vec![large, -large, -1],
            vec![-3; 1000],
            vec![i128::from(u64::MAX); 4096],
        ] {
            assert_eq!(stats_of(&values).explained(), values.iter().sum::<i128>());
        }
    }
}
