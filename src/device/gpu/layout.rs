//! Structs and constants that Rust and WGSL share. Each is defined here, or in [`words`] of the energy, and nowhere
//! else: [`wgsl`] declares them in front of every kernel.

use super::Tuning;
use crate::device::{FLOOD_FROM, FREE};
use crate::energy::shared::{Atomic, List, Struct, shared, wide};
use crate::energy::{LatticeEnergy, words};

/// `label_at_merge` of a face that is not on the boundary list.
pub const UNLISTED: u32 = u32::MAX - 1;

/// Words of the sums of a cluster.
pub const fn sum_words(axes: usize) -> usize {
    2 * words::sums(axes)
}

/// All structs that kernels see.
pub fn structs() -> impl Iterator<Item = &'static Struct> {
    words::WIDE.iter().chain(WIDE).chain(STRUCTS)
}

/// The declarations of all constants and types, for points of so many axes.
pub fn wgsl(tuning: &Tuning, axes: usize) -> String {
    let constants = [
        ("FREE", FREE),
        ("FLOOD_FROM", FLOOD_FROM),
        ("UNLISTED", UNLISTED),
        ("WORKGROUP", tuning.workgroup),
        ("RUN", tuning.run),
        ("AXES", axes as u32),
        ("SUMS", words::sums(axes) as u32),
        ("SUM_WORDS", sum_words(axes) as u32),
    ];
    let constants = constants.map(|(name, value)| format!("const {name}: u32 = {value}u;\n"));
    // a vector is read at once
    let point = if axes == 3 { "vec3<i32>".to_owned() } else { format!("array<i32, {axes}>") };
    let point = format!("alias Point = {point};\n");
    constants.into_iter().chain([point]).chain(structs().map(Struct::wgsl)).collect()
}

wide! {
    /// Sums over the faces of a cluster, and its leavers of this iteration. The host only clears it.
    CLUSTER = Cluster(|axes| sum_words(axes) + 5) {
        /// The sums of the energy, 64 bits each, low word first, two's complement.
        sums: [Atomic; SUM_WORDS],
        /// Number of faces.
        count: Atomic,
        /// Faces of the cluster, less those that want to leave in this iteration.
        staying: Atomic,
        /// Smallest face that wants to leave.
        first_leaver: Atomic,
        /// 1: known to be connected, and it has lost no face since.
        connected: Atomic,
        /// Twice the last iteration in which it changed or a face of it bid; one more if it changed: gained or lost a
        /// face, or got another proxy as a flood ended.
        active_in: Atomic,
    }

    /// The bids at a cluster, and the move that leaves it. Its joining faces are counted from zero in each iteration.
    CLUSTER_BIDS = ClusterBids(|axes| 7 + sum_words(axes)) {
        /// The largest packed gain of the faces that want to leave or enter, 0 without any.
        best_bid: Atomic,
        /// The smallest face with that gain.
        best_face: Atomic,
        /// The iteration in which a face last won a move out of the cluster.
        won_in: u32,
        /// That face.
        winner: u32,
        /// The cluster that it wants to enter.
        target_cluster: u32,
        /// What was decided: a constant of `shaders/shared/bids.wgsl`.
        accepted: u32,
        /// Number of the faces that join the move.
        joining: Atomic,
        /// Their sums, as in `Cluster`.
        joining_sums: [Atomic; SUM_WORDS],
    }

    /// The sums of a cluster, for the host.
    COPIED_SUMS = CopiedSums(|axes| sum_words(axes) + 1) {
        /// As in `Cluster`.
        sums: [u32; SUM_WORDS],
        /// Number of faces.
        count: u32,
    }
}

shared! {
    /// A uniform: an iteration of a phase, or a pass of the growth. Its size must be a multiple of 16 bytes.
    Iteration {
        /// Index of its entry in the statistics.
        slot: u32,
        /// 1: outside a batch of iterations. Kernels then do their work even though nothing moved.
        between: u32,
        /// Number of faces.
        faces: u32,
        /// Number of clusters that are left.
        clusters: u32,
        /// Number of the iteration on this surface, from 1; of the boundary phase, that of the pass.
        number: u32,
        /// Number of entries of a list: of `host_list`, of the candidates, or of clusters whose sums the host wants.
        entries: u32,
        /// 1: of equally cheap dual edges, the one to the neighbour with the largest number is the best.
        prefers_largest_id: u32,
        /// Which half of the boundary list is in use: 0 or 1.
        half: u32,
        /// Number of the batch, from 1.
        batch: u32,
        /// 1: faces that moved since the last merge stay listed.
        keeps_moved: u32,
        /// The number of the iteration in its phase.
        in_phase: u32,
        /// Padding.
        unused: u32,
    }

    /// What an iteration reports to the host.
    IterationStats {
        /// Σ over clusters of the explained energy << shift, in refinement its rise, modulo 2¹²⁸: three 64-bit sums of
        /// weight 1, 2³² and 2⁶⁴, low word first.
        explained: [Atomic; 6],
        /// Faces whose label changed.
        moves: Atomic,
        /// Faces that wanted to move; of a repair, faces that it freed.
        movers: Atomic,
        /// Listed faces at the end of the iteration.
        listed: Atomic,
        /// Those that were due.
        due: Atomic,
        /// Entries of `moves`.
        entries: Atomic,
    }

    /// The best move of a listed face, in refinement.
    FaceBid {
        /// The cluster that it wants to enter.
        wanted: u32,
        /// The packed gain; 0 without a bid.
        bid: u32,
    }

    /// The piece that a cluster keeps; cleared memory is no piece.
    LargestPiece {
        /// Number of its faces.
        size: Atomic,
        /// Its smallest face, inverted, so that the maximum finds the smallest.
        inverted_root: Atomic,
    }

    /// Faces that dispatches go over.
    BoundaryList {
        /// Listed faces in each half of `entries`, movers of even and of odd iterations, freed faces.
        lengths: [Atomic; 5],
        /// The batch in which the phase has ended, or 0.
        ended: u32,
        /// The last pass of the boundary phase in which a face moved.
        moved_in: Atomic,
        /// Faces that were due in this iteration.
        due: Atomic,
        /// Two halves of one entry a face: the listed faces, and the movers.
        entries: List,
    }

    /// The best dual edge of a cluster so far, all numbers inverted: cleared memory is worse than any edge, and the
    /// larger number is the better one.
    BestDualEdge {
        /// The packed cost; 0 without an edge, as no edge has that.
        cost: Atomic,
        /// The smallest tie of the edges with that cost.
        tie: Atomic,
        /// The smallest neighbour of those.
        other: Atomic,
    }

    /// The best dual edge of a cluster, for the host.
    DualEdge {
        /// The neighbour; FREE without an edge.
        other: u32,
        /// The packed cost.
        cost: u32,
    }

    /// The cheapest dual edge of some threads, by exact cost in units of the finest component.
    CandidateEdge {
        /// Upper 64 bits of the cost.
        high_cost: u64,
        /// Lower 64 bits.
        low_cost: u64,
        /// Of equal costs the smallest tie wins, then the smallest ends.
        tie: u32,
        /// The end with the smaller number; FREE where there is no edge.
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
}

impl IterationStats {
    /// The energy that the iteration left.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.explained() }
    }

    /// The explained energy; in refinement, its rise. The device adds modulo 2¹²⁸ in two's complement, and the true
    /// value fits.
    pub fn explained(&self) -> i128 {
        let limb = |at: usize| u128::from(self.explained[2 * at]) | u128::from(self.explained[2 * at + 1]) << 32;
        let sum = limb(0).wrapping_add(limb(1) << 32).wrapping_add(limb(2) << 64);
        sum.cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

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
        IterationStats { explained, ..Zeroable::zeroed() }
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
