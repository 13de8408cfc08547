//! The table of kernels. A kernel is its WGSL file, a row here, and a dispatch: layouts, pipelines and bind groups are
//! made from the row. `tests/shader_layout.rs` compares each row with what the file declares.
//!
//! A WGSL file names the shared pieces that it needs in its first line, as in `//! uses: cluster_sums, stats`; `energy`
//! stands for the file of the energy in `shaders/energy/`. [`Kernel::source`] puts them, and what they need, in front.

use std::mem::size_of;

use super::buffers::Buffer::{self, *};
use super::layout::{Iteration, WORKGROUP};
use crate::energy::{Energy, Functional};

/// A compute shader with one entry point.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Name, unique.
    pub name: &'static str,
    /// Folder and name of its file in `shaders/`; the entry point has the file's name.
    pub path: &'static str,
    /// The file.
    pub wgsl: &'static str,
    /// A pipeline-overridable constant of the file, and its value.
    pub constant: Option<(&'static str, u32)>,
    /// How many threads a dispatch has.
    pub threads: Threads,
    /// Threads in a workgroup.
    pub workgroup_size: u32,
    /// The buffers of bindings 1, 2, …; binding 0 is the [`Iteration`].
    pub bindings: &'static [Binding],
}

/// A storage buffer that a kernel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// The buffer.
    pub buffer: Buffer,
    /// Name of the variable, if not that of the buffer.
    pub alias: Option<&'static str>,
    /// Whether the kernel writes it.
    pub is_written: bool,
}

impl Binding {
    /// Name of the variable.
    pub fn name(&self) -> &'static str {
        self.alias.unwrap_or(self.buffer.spec().name)
    }
}

/// The threads of a dispatch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// One workgroup.
    One,
    /// A thread a face.
    Faces,
    /// A thread for [`RUN`](super::layout::RUN) faces.
    FaceRuns,
    /// A thread a cluster that is left.
    Clusters,
    /// A thread an entry of the list that the host wrote.
    Entries,
    /// A thread a listed face, or none at all after the end of a phase: an indirect dispatch.
    Listed,
}

impl Kernel {
    /// The shared pieces that it uses, and its own file.
    pub fn source(&self) -> String {
        let (mut used, mut source) = (Vec::new(), String::new());
        splice(self.wgsl, &mut used, &mut source);
        source
    }

    /// Name of the entry point.
    pub fn entry_point(&self) -> &'static str {
        self.path.rsplit('/').next().unwrap_or(self.path)
    }

    /// Whether only hierarchies need it.
    pub fn is_merging(&self) -> bool {
        self.path.starts_with("merge/")
    }

    /// Bytes of the smallest buffer for each binding.
    pub fn binding_sizes(&self) -> impl Iterator<Item = usize> {
        let storage = self.bindings.iter().map(|binding| binding.buffer.spec().stride);
        std::iter::once(size_of::<Iteration>()).chain(storage)
    }
}

/// The names in the first line of a WGSL text, if it names shared pieces.
pub fn uses(wgsl: &'static str) -> impl Iterator<Item = &'static str> {
    let line = wgsl.lines().next().and_then(|line| line.strip_prefix("//! uses: ")).unwrap_or("");
    line.split(", ").filter(|name| !name.is_empty())
}

/// Appends the pieces that a text uses, each once and after those that it needs itself, and then the text.
fn splice(wgsl: &'static str, used: &mut Vec<&'static str>, source: &mut String) {
    for name in uses(wgsl) {
        if !used.contains(&name) {
            used.push(name);
            let file = if name == "energy" { Energy::NAME } else { name };
            // a name without a file leaves a source that does not parse; a test parses all
            let piece = PIECES.iter().find(|(path, _)| path.rsplit('/').next() == Some(file));
            splice(piece.map_or("", |(_, text)| text), used, source);
        }
    }
    source.push_str(wgsl);
    source.push('\n');
}

/// Reads files of `shaders/`.
macro_rules! wgsl {
    ($path:literal) => {
        include_str!(concat!("../../../shaders/", $path, ".wgsl"))
    };
}

/// Lists shared pieces: paths and texts.
macro_rules! pieces {
    ($($path:literal,)*) => {
        /// The shared pieces of shaders: folder and name of the file, and its text.
        pub const PIECES: &[(&str, &str)] = &[$(($path, wgsl!($path))),*];
    };
}

pieces! {
    "energy/cvd",
    "shared/best_dual_edge",
    "shared/bids",
    "shared/boundary_insert",
    "shared/boundary_keep",
    "shared/boundary_list",
    "shared/candidate_edge",
    "shared/cluster",
    "shared/cluster_sums",
    "shared/cover",
    "shared/energy_total",
    "shared/float",
    "shared/items",
    "shared/iteration",
    "shared/largest_piece",
    "shared/move_count",
    "shared/piece_tree",
    "shared/stats",
    "shared/ties",
    "shared/wide",
}

/// Rows: name, file, a constant, threads, workgroup size, buffers that are read, buffers that are read and written.
macro_rules! kernels {
    ($($name:ident = $path:literal $(($constant:literal = $value:literal))?, $threads:ident, $size:expr,
        [$($read:ident),*], [$($write:ident $(as $alias:literal)?),*];)*) => {
        $(
            #[doc = concat!("`shaders/", $path, ".wgsl`")]
            pub const $name: &Kernel = &Kernel {
                name: stringify!($name),
                path: $path,
                wgsl: wgsl!($path),
                constant: [$(Some(($constant, $value)),)? None][0],
                threads: Threads::$threads,
                workgroup_size: $size,
                bindings: &[
                    $(Binding { buffer: $read, alias: None, is_written: false },)*
                    $(Binding { buffer: $write, alias: [$(Some($alias),)? None][0], is_written: true },)*
                ],
            };
        )*

        /// All kernels.
        pub const KERNELS: &[&Kernel] = &[$($name),*];
    };
}

kernels! {
    SUMS_GATHER = "sums/sums_gather", FaceRuns, WORKGROUP, [Faces, Labels], [Clusters];
    PROXIES_FIT = "sums/proxies_fit", Clusters, WORKGROUP,
        [], [Clusters, Proxies, ClusterBids, Stats, NextDispatch, BoundaryList];

    GROWTH_PROPOSE = "growth/growth_propose", Listed, WORKGROUP,
        [Faces, Neighbours, Labels], [WantedClusters, Clusters, Stats, BoundaryList];
    GROWTH_APPLY = "growth/growth_apply", Listed, WORKGROUP, [WantedClusters], [Labels, BoundaryList];
    GROWTH_CHECK_DONE = "growth/growth_check_done", One, 1, [], [Stats, NextDispatch];

    BOUNDARY_BUILD = "boundary/boundary_build", Faces, WORKGROUP, [Neighbours, Labels], [LabelAtMerge, BoundaryList];
    BOUNDARY_COMPACT = "boundary/boundary_compact", Listed, WORKGROUP,
        [Neighbours, Labels], [LabelAtMerge, BoundaryList];
    BOUNDARY_PUBLISH = "boundary/boundary_publish", One, 1, [], [NextDispatch, BoundaryList];
    BOUNDARY_COVER = "boundary/boundary_cover", One, 1, [], [NextDispatch, BoundaryList];
    BOUNDARY_PROPOSE = "boundary/boundary_propose", Listed, WORKGROUP,
        [Faces, Neighbours, Labels, Proxies], [WantedClusters, Clusters, BoundaryList];
    BOUNDARY_APPLY = "boundary/boundary_apply", Listed, WORKGROUP,
        [Faces, Neighbours, WantedClusters], [Labels, Clusters, Stats, LabelAtMerge, BoundaryList];

    FACE_BID = "refine/face_bid", Listed, WORKGROUP,
        [Faces, Neighbours, Labels, Proxies], [Clusters, ClusterBids, FaceBids, BoundaryList];
    SELECT_BIDS = "refine/select_bids", Listed, WORKGROUP, [Labels, FaceBids], [ClusterBids, Stats, BoundaryList];
    JOIN_MOVES = "refine/join_moves", Listed, WORKGROUP,
        [Faces, Neighbours, Labels], [FaceBids, ClusterBids, JoiningSums as "clusters", LabelAtMerge, BoundaryList];
    EVALUATE_MOVES = "refine/evaluate_moves", Clusters, WORKGROUP,
        [Faces], [Clusters, JoiningSums, Proxies, ClusterBids, Stats, NextDispatch, BoundaryList];
    COMMIT_MOVES = "refine/commit_moves", Listed, WORKGROUP, [], [Labels, FaceBids, ClusterBids, BoundaryList];

    PIECE_LINK = "pieces/piece_link", Faces, WORKGROUP, [Neighbours, Labels], [Clusters, Parents, PieceSizes];
    PIECE_UNION = "pieces/piece_union", Faces, WORKGROUP, [Neighbours, Labels], [Parents];
    PIECE_SIZE = "pieces/piece_size", FaceRuns, WORKGROUP, [Labels], [Parents, PieceSizes, LargestPieces];
    PIECE_SELECT_LARGEST = "pieces/piece_select_largest", Faces, WORKGROUP,
        [Labels, Parents, PieceSizes], [Clusters, LargestPieces];
    PIECE_DETACH = "pieces/piece_detach", Faces, WORKGROUP,
        [Faces, Parents], [Labels, Clusters, LargestPieces, Stats, LabelAtMerge, BoundaryList];

    MIN_DUAL_EDGE_COST = "merge/min_dual_edge" ("PASS" = 0), Listed, WORKGROUP,
        [Neighbours, Labels, Proxies], [Clusters, BestDualEdges, BoundaryList];
    MIN_DUAL_EDGE_TIE = "merge/min_dual_edge" ("PASS" = 1), Listed, WORKGROUP,
        [Neighbours, Labels, Proxies], [Clusters, BestDualEdges, BoundaryList];
    MIN_DUAL_EDGE_OTHER = "merge/min_dual_edge" ("PASS" = 2), Listed, WORKGROUP,
        [Neighbours, Labels, Proxies], [Clusters, BestDualEdges, BoundaryList];
    DUAL_EDGES_PUBLISH = "merge/dual_edges_publish", Clusters, WORKGROUP,
        [], [BestDualEdges, DualEdges, BoundaryList];
    CHEAPEST_DUAL_EDGE = "merge/cheapest_dual_edge", Listed, WORKGROUP,
        [Neighbours, Labels, Proxies], [Clusters, CandidateEdges, BoundaryList];
    CHEAPEST_DUAL_EDGE_REDUCE = "merge/cheapest_dual_edge_reduce", One, WORKGROUP,
        [], [CandidateEdges, BoundaryList];
    MERGE_APPLY = "merge/merge_apply", Entries, WORKGROUP, [HostList], [Clusters, MergedInto];
    MERGE_RELABEL = "merge/merge_relabel", Faces, WORKGROUP, [MergedInto], [Labels, LabelAtMerge];
    MOVES_LIST = "merge/moves_list", Listed, WORKGROUP, [Labels, LabelAtMerge], [Moves, Stats, BoundaryList];
    SUMS_COPY = "merge/sums_copy", Entries, WORKGROUP, [HostList], [Clusters, CopiedSums];
}
