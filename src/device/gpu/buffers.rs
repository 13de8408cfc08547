//! The storage buffers of a surface on the device: one row each.

use std::mem::{offset_of, size_of};

use super::layout::{self, CLUSTER, CLUSTER_BIDS, COPIED_SUMS, IterationStats, Move};
use crate::energy::words::{FACE, PROXY};

/// Iterations in the largest batch.
pub const BATCH: u32 = 64;

/// Sums that the host reads at a time.
const MOST_COPIED: u64 = 1 << 18;

/// Numbers that the lengths of buffers depend on.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Coordinates of a point.
    pub axes: usize,
    /// Faces.
    pub faces: u64,
    /// Neighbours of all faces.
    pub neighbours: u64,
    /// Clusters.
    pub clusters: u64,
    /// Workgroups of a dispatch with a thread a face.
    pub face_groups: u64,
}

impl Sizes {
    /// Of a closed triangle mesh.
    pub fn of(axes: usize, faces: u64, clusters: u64) -> Self {
        Self { axes, faces, neighbours: 3 * faces, clusters, face_groups: faces.div_ceil(32) }
    }
}

/// A row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Spec {
    /// Name of the variable in WGSL.
    pub name: &'static str,
    /// Its type in kernels that write it; those that only read it see no atomics.
    pub wgsl: &'static str,
    /// The member that has the items, if the type is a struct.
    pub member: Option<&'static str>,
    /// Bytes before the items.
    pub head: usize,
    /// Bytes of an item for points of so many axes.
    pub stride: fn(usize) -> usize,
    /// Items of the buffer.
    items: fn(&Sizes) -> u64,
}

impl Spec {
    /// Items of the buffer; one at least.
    pub fn items(&self, sizes: &Sizes) -> u64 {
        (self.items)(sizes).max(1)
    }

    /// Bytes of so many items.
    pub fn bytes_of(&self, items: u64, axes: usize) -> u64 {
        self.head as u64 + items * (self.stride)(axes) as u64
    }

    /// Bytes of the buffer.
    pub fn bytes(&self, sizes: &Sizes) -> u64 {
        self.bytes_of(self.items(sizes), sizes.axes)
    }
}

/// Bytes of a type, for any number of axes.
fn of<T>(_: usize) -> usize {
    size_of::<T>()
}

macro_rules! buffers {
    ($(
        $(#[$doc:meta])*
        $variant:ident = $name:literal: $wgsl:literal
            $(($member:literal behind $head:expr))?, $stride:expr, $items:expr;
    )*) => {
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
                        wgsl: $wgsl,
                        member: [$(Some($member),)? None][0],
                        head: [$($head,)? 0][0],
                        stride: $stride,
                        items: $items,
                    },)*
                }
            }
        }
    };
}

impl Buffer {
    /// The one whose memory it has: passes of the growth, iterations of either phase and searches for pieces leave
    /// nothing in it that the others need.
    pub fn memory(self) -> Self {
        match self {
            Self::WantedClusters | Self::Pieces => Self::FaceBids,
            own => own,
        }
    }
}

buffers! {
    /// Points and weights.
    Faces = "faces": "array<Face>", |axes| FACE.bytes(axes), |sizes| sizes.faces;
    /// For each face the index of its first neighbour, one more index for the end, and then the neighbours.
    Neighbours = "neighbours": "array<u32>", of::<u32>, |sizes| sizes.faces + 1 + sizes.neighbours;
    /// The cluster of each face.
    Labels = "labels": "array<u32>", of::<u32>, |sizes| sizes.faces;
    /// The cluster that a face moves to in this iteration: of movers, and of free faces that are listed.
    WantedClusters = "wanted_clusters": "array<u32>", of::<u32>, |sizes| sizes.faces;
    /// The label of each face after the last merge, or that it is not listed.
    LabelAtMerge = "label_at_merge": "array<atomic<u32>>", of::<u32>, |sizes| sizes.faces;
    /// Boundary faces.
    BoundaryList = "boundary_list": "BoundaryList" ("entries" behind offset_of!(layout::BoundaryList, entries)),
        of::<u32>, |sizes| 2 * sizes.faces;
    /// The clusters that are left; the host writes them.
    LivingClusters = "living_clusters": "array<u32>", of::<u32>, |sizes| sizes.clusters;
    /// Sums of each cluster.
    Clusters = "clusters": "array<Cluster>", |axes| CLUSTER.bytes(axes), |sizes| sizes.clusters;
    /// Proxy of each cluster.
    Proxies = "proxies": "array<Proxy>", |axes| PROXY.bytes(axes), |sizes| sizes.clusters;
    /// Refinement: the best move of each face.
    FaceBids = "face_bids": "array<FaceBid>", of::<layout::FaceBid>, |sizes| sizes.faces;
    /// Refinement: the bids at each cluster, and the move out of it.
    ClusterBids = "cluster_bids": "array<ClusterBids>", |axes| CLUSTER_BIDS.bytes(axes), |sizes| sizes.clusters;
    /// The tree of each face: it points to a smaller face of its piece, the smallest to itself, and a face of no piece
    /// to FREE. Behind all of these the number of faces of each piece, at its smallest face.
    Pieces = "pieces": "array<atomic<u32>>", of::<u32>, |sizes| 2 * sizes.faces;
    /// Pieces: the one that each cluster keeps.
    LargestPieces = "largest_pieces": "array<LargestPiece>", of::<layout::LargestPiece>, |sizes| sizes.clusters;
    /// What each iteration of a batch reports, then what is done between batches, and before them.
    Stats = "stats": "array<IterationStats>", of::<IterationStats>, |_| u64::from(BATCH) + 2;
    /// The best dual edge of each cluster so far; cleared between searches.
    BestDualEdges = "best_dual_edges": "array<BestDualEdge>", of::<layout::BestDualEdge>, |sizes| sizes.clusters;
    /// The best dual edge of each cluster that is left, for the host.
    DualEdges = "dual_edges": "array<DualEdge>", of::<layout::DualEdge>, |sizes| sizes.clusters;
    /// The cheapest dual edge of each workgroup.
    CandidateEdges = "candidate_edges": "array<CandidateEdge>", of::<layout::CandidateEdge>, |sizes| sizes.face_groups;
    /// The numbers of clusters, which decide ties.
    ClusterNumbers = "cluster_numbers": "array<u32>", of::<u32>, |sizes| sizes.clusters;
    /// For each cluster 0, or one more than the cluster that it was merged into.
    MergedInto = "merged_into": "array<u32>", of::<u32>, |sizes| sizes.clusters;
    /// A list of the host: pairs that merge, or clusters whose sums are copied.
    HostList = "host_list": "array<u32>", of::<u32>, |sizes| sizes.clusters.max(2);
    /// Sums for the host.
    CopiedSums = "copied_sums": "array<CopiedSums>", |axes| COPIED_SUMS.bytes(axes), |sizes| {
        sizes.clusters.clamp(2, MOST_COPIED)
    };
    /// Faces that moved since the last merge, for the host.
    Moves = "moves": "array<Move>", of::<Move>, |sizes| sizes.faces;
}
