//! What Rust and WGSL share: the structs of `shaders/shared`, byte for byte. `tests/shader_layout.rs` compares [`STRUCTS`]
//! with what the shaders declare.

use std::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

use crate::cluster::sums::ClusterSums;

/// Threads in a workgroup of every kernel that has one thread an item.
pub const WORKGROUP: u32 = 256;

/// Faces that one thread of `sums_gather` takes.
pub const GATHER_RUN: u32 = 8;

/// The origin of a face that is not listed.
pub const UNLISTED: u32 = u32::MAX - 1;

/// [`Turn::ties`] for [`Ties::Hash`](crate::cluster::dual_edge::Ties::Hash).
pub const TIES_BY_HASH: u32 = 0;

/// [`Turn::ties`] for [`Ties::LargestId`](crate::cluster::dual_edge::Ties::LargestId).
pub const TIES_BY_LARGEST_ID: u32 = 1;

/// One turn of the device: an iteration, or a pass of the growth. A uniform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Turn {
    /// Where in the ring its numbers go.
    pub slot: u32,
    /// 1: between batches; `proxies_fit` works even though nothing moved.
    pub forced: u32,
    /// Number of faces.
    pub faces: u32,
    /// Number of clusters that are left.
    pub clusters: u32,
    /// Workgroups in a full row of a dispatch.
    pub row: u32,
    /// Number of the turn in its phase, from 1.
    pub number: u32,
    /// Number of entries in a list that the host wrote.
    pub entries: u32,
    /// Which of equally cheap dual edges is the best: [`TIES_BY_HASH`] or [`TIES_BY_LARGEST_ID`]. With it the size is a
    /// multiple of 16 bytes, which uniforms must have.
    pub ties: u32,
}

/// What a turn leaves in the ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Slot {
    /// Three 64-bit sums, low word first, that count 1, 2³² and 2⁶⁴.
    pub explained: [u32; 6],
    /// Faces whose label changed.
    pub moves: u32,
    /// Faces that bid, in refinement.
    pub bids: u32,
}

impl Slot {
    /// The explained energy; in refinement, what it rose by. The device adds modulo 2¹²⁸ in two's complement, and the true value fits.
    pub fn explained(&self) -> i128 {
        let limb = |at: usize| u128::from(self.explained[2 * at]) | u128::from(self.explained[2 * at + 1]) << 32;
        let sum = limb(0).wrapping_add(limb(1) << 32).wrapping_add(limb(2) << 64);
        sum.cast_signed()
    }
}

/// Sums of a cluster. Only the device looks inside; the host clears it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Cluster {
    /// Σ weight·centroid: 64 bits an axis, low word first.
    pub sum: [u32; 6],
    /// Σ weight, low word first.
    pub weight: [u32; 2],
    /// Number of faces.
    pub count: u32,
    /// Faces that do not want to leave.
    pub staying: u32,
    /// Smallest face that wants to leave.
    pub first_leaver: u32,
    /// Whether it is known to be in one piece.
    pub whole: u32,
}

/// The bid of a face. The host clears it at the beginning of a refinement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Offer {
    /// Where it wants to go.
    pub cluster: u32,
    /// Its packed gain.
    pub bid: u32,
    /// The turn in which it was last refused.
    pub refused_in: u32,
}

/// A cluster's place in the bidding. Only the device looks inside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Market {
    /// The largest packed gain.
    pub best_bid: u32,
    /// The smallest face with that gain.
    pub best_face: u32,
    /// The turn in which a face last won a move from here.
    pub dealt_in: u32,
    /// That face.
    pub winner: u32,
    /// Where it wants to go.
    pub target_cluster: u32,
    /// What was decided.
    pub verdict: u32,
    /// The turn in which the cluster last gained or lost a face.
    pub changed_in: u32,
    /// Padding.
    pub unused: u32,
}

/// The best dual edge of a cluster, all numbers inverted. The host clears it before the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Choice {
    /// The packed cost.
    pub cost: u32,
    /// What orders the edges with that cost.
    pub tie: u32,
    /// The neighbour.
    pub other: u32,
}

/// What dispatches go over. Only the device looks inside; the host writes the clusters that are left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Lists {
    /// Faces that are listed.
    pub length: u32,
    /// Faces that have been kept so far.
    pub kept: u32,
    /// Faces that dispatches go over.
    pub due: u32,
    /// Where in the entries they are.
    pub first: u32,
    /// The first of two entries a face and one a cluster.
    pub entries: [u32; 1],
}

/// Something that the device lists for the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Found {
    /// A cluster that has a dual edge, or a face that moved.
    pub subject: u32,
    /// The neighbour, or where the face was.
    pub first: u32,
    /// The packed cost, or where the face is.
    pub second: u32,
}

/// The best dual edge of a workgroup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Best {
    /// The exact cost in units of the finest component, low word first.
    pub cost: [u32; 4],
    /// What orders the edges with that cost.
    pub tie: u32,
    /// The end with the smaller number; [`FREE`](crate::device::FREE) where there is no edge.
    pub low: u32,
    /// The other end.
    pub high: u32,
    /// Padding.
    pub unused: u32,
}

/// The sums of a cluster, for the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Picked {
    /// Σ weight·centroid: 64 bits an axis, low word first.
    pub sum: [u32; 6],
    /// Σ weight, low word first.
    pub weight: [u32; 2],
    /// Number of faces.
    pub count: u32,
}

impl Picked {
    /// As the host knows them.
    pub fn sums(&self) -> ClusterSums {
        let number = |low: u32, high: u32| (u64::from(high) << 32 | u64::from(low)).cast_signed();
        ClusterSums {
            centroid: std::array::from_fn(|axis| number(self.sum[2 * axis], self.sum[2 * axis + 1])),
            weight: number(self.weight[0], self.weight[1]),
            faces: self.count,
        }
    }
}

/// A face: its centroid, and its weight's bits.
pub type Face = [i32; 4];

/// A proxy: its position, and the energy shift of its cluster.
pub type Proxy = [i32; 4];

/// Workgroups of an indirect dispatch.
pub type Dispatch = [u32; 3];

/// A struct that WGSL declares too.
#[derive(Debug, Clone, Copy)]
pub struct Struct {
    /// Its name in WGSL.
    pub name: &'static str,
    /// Size in bytes.
    pub size: usize,
    /// Names and offsets of its members, padding included where WGSL names it as one member.
    pub members: &'static [(&'static str, usize)],
}

/// All structs that both sides declare.
pub const STRUCTS: &[Struct] = &[
    Struct {
        name: "Turn",
        size: size_of::<Turn>(),
        members: &[
            ("slot", offset_of!(Turn, slot)),
            ("forced", offset_of!(Turn, forced)),
            ("faces", offset_of!(Turn, faces)),
            ("clusters", offset_of!(Turn, clusters)),
            ("row", offset_of!(Turn, row)),
            ("number", offset_of!(Turn, number)),
            ("entries", offset_of!(Turn, entries)),
            ("ties", offset_of!(Turn, ties)),
        ],
    },
    Struct {
        name: "Slot",
        size: size_of::<Slot>(),
        members: &[
            ("explained", offset_of!(Slot, explained)),
            ("moves", offset_of!(Slot, moves)),
            ("bids", offset_of!(Slot, bids)),
        ],
    },
    Struct {
        name: "Cluster",
        size: size_of::<Cluster>(),
        members: &[
            ("sum", offset_of!(Cluster, sum)),
            ("weight", offset_of!(Cluster, weight)),
            ("count", offset_of!(Cluster, count)),
            ("staying", offset_of!(Cluster, staying)),
            ("first_leaver", offset_of!(Cluster, first_leaver)),
            ("whole", offset_of!(Cluster, whole)),
        ],
    },
    Struct {
        name: "Offer",
        size: size_of::<Offer>(),
        members: &[
            ("cluster", offset_of!(Offer, cluster)),
            ("bid", offset_of!(Offer, bid)),
            ("refused_in", offset_of!(Offer, refused_in)),
        ],
    },
    Struct {
        name: "Market",
        size: size_of::<Market>(),
        members: &[
            ("best_bid", offset_of!(Market, best_bid)),
            ("best_face", offset_of!(Market, best_face)),
            ("dealt_in", offset_of!(Market, dealt_in)),
            ("winner", offset_of!(Market, winner)),
            ("target_cluster", offset_of!(Market, target_cluster)),
            ("verdict", offset_of!(Market, verdict)),
            ("changed_in", offset_of!(Market, changed_in)),
            ("unused", offset_of!(Market, unused)),
        ],
    },
    Struct {
        name: "Choice",
        size: size_of::<Choice>(),
        members: &[
            ("cost", offset_of!(Choice, cost)),
            ("tie", offset_of!(Choice, tie)),
            ("other", offset_of!(Choice, other)),
        ],
    },
    Struct {
        name: "Lists",
        size: size_of::<Lists>(),
        members: &[
            ("length", offset_of!(Lists, length)),
            ("kept", offset_of!(Lists, kept)),
            ("due", offset_of!(Lists, due)),
            ("first", offset_of!(Lists, first)),
            ("entries", offset_of!(Lists, entries)),
        ],
    },
    Struct {
        name: "Found",
        size: size_of::<Found>(),
        members: &[
            ("subject", offset_of!(Found, subject)),
            ("first", offset_of!(Found, first)),
            ("second", offset_of!(Found, second)),
        ],
    },
    Struct {
        name: "Best",
        size: size_of::<Best>(),
        members: &[
            ("cost", offset_of!(Best, cost)),
            ("tie", offset_of!(Best, tie)),
            ("low", offset_of!(Best, low)),
            ("high", offset_of!(Best, high)),
            ("unused", offset_of!(Best, unused)),
        ],
    },
    Struct {
        name: "Picked",
        size: size_of::<Picked>(),
        members: &[
            ("sum", offset_of!(Picked, sum)),
            ("weight", offset_of!(Picked, weight)),
            ("count", offset_of!(Picked, count)),
        ],
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    /// The slot that a device leaves which adds the limbs of `values` one by one.
    fn slot_of(values: &[i128]) -> Slot {
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
        Slot { explained, moves: 0, bids: 0 }
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
            assert_eq!(slot_of(&values).explained(), values.iter().sum::<i128>());
        }
    }
}
