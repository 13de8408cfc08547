//! The table of kernels. A kernel is its WGSL file, a row here, and a dispatch.
//!
//! A file has a function of its own name, which takes the number of the thread, and that of the thread in its
//! workgroup; kernels of one thread take neither. Its first lines name the shared pieces that it uses, the buffers that
//! it reads, and those that it writes; a buffer with atomics counts as written:
//!
//! ```wgsl
//! //! uses: boundary_list, energy
//! //! reads: faces, labels
//! //! writes: wanted_clusters, clusters
//! ```
//!
//! `energy` is the file of the energy in `shaders/energy/`. [`Kernel::source`] puts the pieces, what they use
//! themselves, and all declarations in front; layouts, pipelines and bind groups are made from the same lines.

use std::mem::size_of;

use super::Tuning;
use super::buffers::{Buffer, Spec};
use super::layout::{self, Iteration};
use crate::energy::words;

/// A compute shader with one entry point.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Name, unique.
    pub name: &'static str,
    /// Folder and name of its file in `shaders/`.
    pub path: &'static str,
    /// The file.
    pub wgsl: &'static str,
    /// A pipeline-overridable constant of the file, and its value.
    pub constant: Option<(&'static str, u32)>,
    /// How many threads a dispatch has.
    pub threads: Threads,
}

/// A storage buffer that a kernel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// The buffer.
    pub buffer: Buffer,
    /// Whether the kernel writes it.
    pub is_written: bool,
}

/// The threads of a dispatch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// One thread.
    One,
    /// One workgroup.
    Group,
    /// A thread a face.
    Faces,
    /// A thread for [`Tuning::run`] faces.
    FaceRuns,
    /// A thread a cluster that is left.
    Clusters,
    /// A thread an entry of the list that the host wrote.
    Entries,
    /// A thread a listed face, or none at all after the end of a phase: an indirect dispatch.
    Listed,
}

impl Kernel {
    /// All of its WGSL.
    pub fn source(&self, tuning: &Tuning) -> String {
        let mut source = layout::wgsl(tuning);
        source.push_str("@group(0) @binding(0) var<uniform> iteration: Iteration;\n");
        for (place, Binding { buffer, is_written }) in (1..).zip(self.bindings()) {
            let Spec { name, wgsl: ty, .. } = buffer.spec();
            let (access, ty) =
                if is_written { ("read_write", ty.to_owned()) } else { ("read", ty.replace("atomic<u32>", "u32")) };
            source.push_str(&format!("@group(0) @binding({place}) var<storage, {access}> {name}: {ty};\n"));
        }
        splice(self.wgsl, &mut Vec::new(), &mut source);
        // not from num_workgroups, which is 0 in an indirect dispatch on DX12 unless wgpu validates those
        let thread = "(group.y * iteration.row + group.x) * WORKGROUP + local, local";
        let (size, arguments) = if self.threads == Threads::One { (1, "") } else { (tuning.workgroup, thread) };
        source.push_str(&format!(
            "@compute @workgroup_size({size})\n\
             fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {{\n    \
             {}({arguments});\n}}\n",
            self.function()
        ));
        source
    }

    /// Name of its file and function.
    pub fn function(&self) -> &'static str {
        self.path.rsplit('/').next().unwrap_or(self.path)
    }

    /// Whether only hierarchies need it.
    pub fn is_merging(&self) -> bool {
        self.path.starts_with("merge/")
    }

    /// The buffers of bindings 1, 2, …; binding 0 is the [`Iteration`].
    pub fn bindings(&self) -> Vec<Binding> {
        let of = |key: &'static str, is_written: bool| {
            names(self.wgsl, key).filter_map(move |name| {
                // a name without a buffer leaves a source that does not parse; a test parses all
                let buffer = Buffer::ALL.iter().copied().find(|buffer| buffer.spec().name == name)?;
                Some(Binding { buffer, is_written })
            })
        };
        of("reads", false).chain(of("writes", true)).collect()
    }

    /// Bytes of the smallest buffer for each binding.
    pub fn binding_sizes(&self) -> impl Iterator<Item = usize> {
        let storage = self.bindings().into_iter().map(|binding| binding.buffer.spec().stride);
        std::iter::once(size_of::<Iteration>()).chain(storage)
    }
}

/// The buffers that a flat clustering needs, or a hierarchy.
pub fn needed(is_merging: bool) -> Vec<Buffer> {
    let kernels = KERNELS.iter().filter(|kernel| is_merging || !kernel.is_merging());
    kernels.flat_map(|kernel| kernel.bindings()).map(|binding| binding.buffer).collect()
}

/// The names that the first lines of a WGSL text have under a key.
pub fn names(wgsl: &'static str, key: &str) -> impl Iterator<Item = &'static str> {
    let head = wgsl.lines().map_while(|line| line.strip_prefix("//! ")).filter_map(|line| line.split_once(": "));
    let list = head.filter(|(found, _)| *found == key).map(|(_, list)| list).next().unwrap_or("");
    list.split(", ").filter(|name| !name.is_empty())
}

/// Appends the pieces that a text uses, each once and after those that it needs itself, and then the text.
fn splice(wgsl: &'static str, used: &mut Vec<&'static str>, source: &mut String) {
    for name in names(wgsl, "uses") {
        if !used.contains(&name) {
            used.push(name);
            // a name without a file leaves a source that does not parse; a test parses all
            splice(PIECES.iter().find(|(piece, _)| *piece == name).map_or("", |(_, text)| text), used, source);
        }
    }
    source.push_str(wgsl);
    source.push('\n');
}

/// Lists the energy and the files of `shaders/shared/`.
macro_rules! pieces {
    ($($name:literal,)*) => {
        /// The shared pieces of shaders: name and text.
        pub const PIECES: &[(&str, &str)] =
            &[("energy", words::WGSL), $(($name, include_str!(concat!("../../../shaders/shared/", $name, ".wgsl")))),*];
    };
}

pieces! {
    "accepted_moves",
    "bids",
    "boundary_insert",
    "boundary_list",
    "candidate_edge",
    "cluster_sums",
    "count",
    "cover",
    "energy_total",
    "float",
    "living_clusters",
    "ties",
    "wide",
}

/// Rows: name, file, a constant, threads.
macro_rules! kernels {
    ($($name:ident = $path:literal $(($constant:literal = $value:literal))?, $threads:ident;)*) => {
        $(
            #[doc = concat!("`shaders/", $path, ".wgsl`")]
            pub const $name: &Kernel = &Kernel {
                name: stringify!($name),
                path: $path,
                wgsl: include_str!(concat!("../../../shaders/", $path, ".wgsl")),
                constant: [$(Some(($constant, $value)),)? None][0],
                threads: Threads::$threads,
            };
        )*

        /// All kernels.
        pub const KERNELS: &[&Kernel] = &[$($name),*];
    };
}

kernels! {
    SUMS_GATHER = "sums/sums_gather", FaceRuns;
    PROXIES_FIT = "sums/proxies_fit", Clusters;

    LABELS_FREE = "growth/labels_free", Faces;
    GROWTH_PROPOSE = "growth/growth_propose", Listed;
    GROWTH_APPLY = "growth/growth_apply", Listed;

    BOUNDARY_BUILD = "boundary/boundary_keep" ("FROM_ALL" = 1), Faces;
    BOUNDARY_COMPACT = "boundary/boundary_keep" ("FROM_ALL" = 0), Listed;
    BOUNDARY_PUBLISH = "boundary/boundary_publish", One;
    BOUNDARY_COVER = "boundary/boundary_cover", One;
    BOUNDARY_PROPOSE = "boundary/boundary_propose", Listed;
    BOUNDARY_APPLY = "boundary/boundary_apply", Listed;

    FACE_BID = "refine/face_bid", Listed;
    SELECT_BIDS = "refine/select_bids", Listed;
    JOIN_MOVES = "refine/join_moves", Listed;
    EVALUATE_MOVES = "refine/evaluate_moves", Clusters;
    COMMIT_MOVES = "refine/commit_moves", Listed;

    PIECE_LINK = "pieces/piece_link", Faces;
    PIECE_UNION = "pieces/piece_union", Faces;
    PIECE_SIZE = "pieces/piece_size", FaceRuns;
    PIECE_SELECT_LARGEST = "pieces/piece_select_largest", Faces;
    PIECE_DETACH = "pieces/piece_detach", Faces;

    MIN_DUAL_EDGE_COST = "merge/min_dual_edge" ("PASS" = 0), Listed;
    MIN_DUAL_EDGE_TIE = "merge/min_dual_edge" ("PASS" = 1), Listed;
    MIN_DUAL_EDGE_OTHER = "merge/min_dual_edge" ("PASS" = 2), Listed;
    DUAL_EDGES_PUBLISH = "merge/dual_edges_publish", Clusters;
    CHEAPEST_DUAL_EDGE = "merge/cheapest_dual_edge", Listed;
    CHEAPEST_DUAL_EDGE_REDUCE = "merge/cheapest_dual_edge_reduce", Group;
    MERGE_APPLY = "merge/merge_apply", Entries;
    MERGE_RELABEL = "merge/merge_relabel", Faces;
    MOVES_LIST = "merge/moves_list", Listed;
    SUMS_COPY = "merge/sums_copy", Entries;
}
