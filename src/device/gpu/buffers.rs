//! The storage buffers of a surface on the device: one row each. No buffer has two meanings.

use std::mem::{offset_of, size_of};

use super::layout::{self, Dispatch, Face, IterationStats, Move, Proxy};

/// Iterations in the largest batch.
pub const BATCH: u32 = 64;

/// Sums that the host reads at a time.
const COPIED_SUMS: u64 = 1 << 18;

/// Numbers that the lengths of buffers depend on.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Faces.
    pub faces: u64,
    /// Neighbours of all faces.
    pub neighbours: u64,
    /// Clusters.
    pub clusters: u64,
    /// Workgroups of a dispatch with a thread a face.
    pub face_groups: u64,
}

/// A row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Spec {
    /// Name of the variable in WGSL.
    pub name: &'static str,
    /// Bytes of an item; of the whole struct for [`Buffer::BoundaryList`] with one entry.
    pub stride: usize,
    /// Bytes of the buffer.
    pub bytes: fn(&Sizes) -> u64,
    /// Whether only hierarchies need it.
    pub is_merging: bool,
}

macro_rules! buffers {
    ($($(#[$doc:meta])* $variant:ident $name:literal: $type:ty, $is_merging:literal, $items:expr;)*) => {
        /// A storage buffer.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Buffer { $($(#[$doc])* $variant,)* }

        impl Buffer {
            /// All of them, in the order of their numbers.
            pub const ALL: &[Self] = &[$(Self::$variant),*];

            /// Its row.
            pub fn spec(self) -> Spec {
                match self {
                    $(Self::$variant => Spec {
                        name: $name,
                        stride: size_of::<$type>(),
                        bytes: |sizes| {
                            let items: fn(&Sizes) -> u64 = $items;
                            items(sizes).max(1) * size_of::<$type>() as u64
                        },
                        is_merging: $is_merging,
                    },)*
                }
            }
        }
    };
}

buffers! {
    /// Centroids and weights.
    Faces "faces": Face, false, |sizes| sizes.faces;
    /// For each face the index of its first neighbour, one more index for the end, and then the neighbours.
    Neighbours "neighbours": u32, false, |sizes| sizes.faces + 1 + sizes.neighbours;
    /// The cluster of each face.
    Labels "labels": u32, false, |sizes| sizes.faces;
    /// By place in the boundary list: the cluster that the face moves to in this iteration.
    WantedClusters "wanted_clusters": u32, false, |sizes| sizes.faces;
    /// The label of each face after the last merge, or that it is not listed.
    LabelAtMerge "label_at_merge": u32, false, |sizes| sizes.faces;
    /// Boundary faces and clusters that are left.
    BoundaryList "boundary_list": layout::BoundaryList, false, |sizes| {
        let words = LIST_HEAD + 2 * sizes.faces + sizes.clusters;
        (4 * words).div_ceil(size_of::<layout::BoundaryList>() as u64)
    };
    /// Sums of each cluster.
    Clusters "clusters": layout::Cluster, false, |sizes| sizes.clusters;
    /// Proxy of each cluster.
    Proxies "proxies": Proxy, false, |sizes| sizes.clusters;
    /// Refinement: the best move of each face.
    FaceBids "face_bids": layout::FaceBid, false, |sizes| sizes.faces;
    /// Refinement: the bids at each cluster.
    ClusterBids "cluster_bids": layout::ClusterBids, false, |sizes| sizes.clusters;
    /// Refinement: sums of the faces that join the move out of each cluster.
    JoiningSums "joining_sums": layout::Cluster, false, |sizes| sizes.clusters;
    /// Pieces: the tree of each face.
    Parents "parents": u32, false, |sizes| sizes.faces;
    /// Pieces: number of faces, at their smallest face.
    PieceSizes "piece_sizes": u32, false, |sizes| sizes.faces;
    /// Pieces: the one that each cluster keeps.
    LargestPieces "largest_pieces": layout::LargestPiece, false, |sizes| sizes.clusters;
    /// What each iteration of a batch reports, and then what is done between batches.
    Stats "stats": IterationStats, false, |_| u64::from(BATCH) + 1;
    /// Workgroups of the indirect dispatches.
    NextDispatch "next_dispatch": Dispatch, false, |_| 1;
    /// The best dual edge of each cluster so far; cleared between searches.
    BestDualEdges "best_dual_edges": layout::BestDualEdge, true, |sizes| sizes.clusters;
    /// The best dual edge of each cluster that is left, for the host.
    DualEdges "dual_edges": layout::DualEdge, true, |sizes| sizes.clusters;
    /// The cheapest dual edge of each workgroup.
    CandidateEdges "candidate_edges": layout::CandidateEdge, true, |sizes| sizes.face_groups;
    /// For each cluster 0, or one more than the cluster that it was merged into.
    MergedInto "merged_into": u32, true, |sizes| sizes.clusters;
    /// A list of the host: pairs that merge, or clusters whose sums are copied.
    HostList "host_list": u32, true, |sizes| sizes.clusters.max(2);
    /// Sums for the host.
    CopiedSums "copied_sums": layout::CopiedSums, true, |sizes| sizes.clusters.min(COPIED_SUMS);
    /// Faces that moved since the last merge, for the host.
    Moves "moves": Move, true, |sizes| sizes.faces;
}

/// Words in front of the entries of [`Buffer::BoundaryList`].
pub const LIST_HEAD: u64 = (offset_of!(layout::BoundaryList, entries) / 4) as u64;
