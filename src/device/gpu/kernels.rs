//! The table of kernels. A kernel is its WGSL file, a row here, and a dispatch.
//!
//! A file has a function of its own name, which is called for each item that the row says: a face, a listed face, a
//! number. A function `<name>_end(local, group)` beside it is called by every thread of a workgroup after its items.
//! The first lines name the shared pieces that it uses, the buffers that it reads, and those that it writes; a buffer
//! with atomics counts as written:
//!
//! ```wgsl
//! //! uses: boundary_list, energy
//! //! reads: faces, labels
//! //! writes: wanted_clusters, clusters
//! ```
//!
//! `energy` is the file of the energy in `shaders/energy/`. What a text has once for each coordinate is written out for
//! their number ([`written_out`]). [`Kernel::source`] puts the pieces, what they use
//! themselves, and all declarations in front; layouts, pipelines and bind groups are made from the same lines.
//!
//! A *chain* is several kernels in one dispatch of one workgroup, with barriers in between. Where a step has few items,
//! that costs less than several dispatches.

use super::Tuning;
use super::axes::written_out;
use super::buffers::{Buffer, Spec};
use super::layout::{self, Iteration, IterationStats};
use super::pages::{self, Bindings};
use crate::device::KernelWork;
use crate::energy::words;

/// A compute shader with one entry point.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Name, unique.
    pub name: &'static str,
    /// What it does: one part, or those of a chain.
    pub parts: &'static [Part],
    /// How often it does that.
    pub rounds: u32,
    /// A pipeline-overridable constant of the file, and its value.
    pub constant: Option<(&'static str, u32)>,
}

/// A WGSL file that is called for items.
#[derive(Debug, Clone, Copy)]
pub struct Part {
    /// Folder and name of its file in `shaders/`.
    pub path: &'static str,
    /// The file.
    pub wgsl: &'static str,
    /// What it is called for.
    pub items: Items,
    /// Bytes that it reads and writes for each item; further ones for each face that is due, wants to move, and moves.
    /// Of a closed triangle mesh, a face seeing one other cluster, each access counted on its own.
    pub bytes: &'static [u64],
}

/// A storage buffer that a kernel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// The buffer.
    pub buffer: Buffer,
    /// Whether the kernel writes it.
    pub is_written: bool,
}

/// What a kernel is called for, by one thread each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Items {
    /// Each face.
    Faces,
    /// The number of each run of [`Tuning::run`] faces.
    FaceRuns,
    /// The place of each cluster that is left, in `living_clusters`.
    Clusters,
    /// The place of each entry of a list of the host.
    Entries,
    /// The same, in one workgroup.
    EntriesAtOnce,
    /// Each listed face; none after the end of a phase.
    Listed,
    /// Each mover; none after the end of a phase.
    Movers,
}

impl Items {
    /// WGSL: how many there are, and the one at a place.
    fn wgsl(self) -> (&'static str, &'static str) {
        match self {
            Self::Faces => ("iteration.faces", "at"),
            Self::FaceRuns => ("(iteration.faces + RUN - 1u) / RUN", "at"),
            Self::Clusters => ("iteration.clusters", "at"),
            Self::Entries | Self::EntriesAtOnce => ("iteration.entries", "at"),
            Self::Listed => ("listed()", "listed_face(at)"),
            Self::Movers => ("movers()", "mover(at)"),
        }
    }

    /// How many there are in an iteration; of runs, their faces.
    pub fn count(self, iteration: &Iteration, stats: &IterationStats) -> u32 {
        match self {
            Self::Faces | Self::FaceRuns => iteration.faces,
            Self::Clusters => iteration.clusters,
            Self::Entries | Self::EntriesAtOnce => iteration.entries,
            Self::Listed => stats.listed,
            Self::Movers => stats.movers,
        }
    }
}

impl Part {
    /// Name of its file and function.
    pub fn function(&self) -> &'static str {
        self.path.rsplit('/').next().unwrap_or(self.path)
    }

    /// The WGSL that calls the function for the items of a thread.
    fn call(&self) -> String {
        let function = self.function();
        let (items, item) = self.items.wgsl();
        let call = format!(
            "    {{\n        let end = {items};\n        \
             for (var at = first; at < end; at += stride) {{ {function}({item}); }}\n"
        );
        let has_end = self.wgsl.contains(&format!("fn {function}_end("));
        let end = if has_end { format!("        {function}_end(local, group.x);\n") } else { String::new() };
        call + &end + "    }\n"
    }
}

impl Kernel {
    /// All of its WGSL, for points of so many axes; with `pages`, for buffers in pages.
    pub fn source(&self, tuning: &Tuning, axes: usize, pages: Option<&Bindings>) -> String {
        let mut declared = layout::wgsl(tuning, axes);
        declared.push_str("@group(0) @binding(0) var<uniform> iteration: Iteration;\n");
        for (place, Binding { buffer, is_written }) in (0..).zip(self.bindings()) {
            let spec @ Spec { name, wgsl: ty, .. } = buffer.spec();
            let (access, mut ty) =
                if is_written { ("read_write", ty.to_owned()) } else { ("read", ty.replace("atomic<u32>", "u32")) };
            if pages.is_some() {
                let (page, of_pages) = pages::declared(&spec, &ty);
                declared.push_str(&page);
                ty = of_pages;
            }
            declared.push_str(&format!("@group(1) @binding({place}) var<storage, {access}> {name}: {ty};\n"));
        }
        let (mut used, mut source) = (Vec::new(), String::new());
        self.parts.iter().for_each(|part| splice((part.function(), part.wgsl), &mut used, &mut source));
        if let Some(bindings) = pages {
            declared.insert_str(0, pages::ENABLE);
            for spec in self.bindings().iter().map(|binding| binding.buffer.spec()) {
                source = pages::paged(&source, &spec, bindings.page(&spec, axes));
            }
        }
        // one barrier for storage, one for memory of the workgroup
        let barriers = "    storageBarrier();\n    workgroupBarrier();\n";
        let mut calls = self.parts.iter().map(Part::call).collect::<Vec<_>>().join(barriers);
        if self.rounds > 1 {
            calls =
                format!("    for (var round = 0u; round < {}u; round++) {{\n{calls}{barriers}    }}\n", self.rounds);
        }
        source.push_str(&format!(
            "@compute @workgroup_size({})\n\
             fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,\n    \
             @builtin(local_invocation_index) local: u32) {{\n    \
             let first = group.x * WORKGROUP + local;\n    let stride = groups.x * WORKGROUP;\n{}}}\n",
            tuning.workgroup, calls,
        ));
        written_out(&(declared + &source), axes, words::sums(axes))
    }

    /// What it does in an iteration; of a chain, the items are those of the first part.
    pub fn work(&self, iteration: &Iteration, stats: &IterationStats) -> KernelWork {
        let bytes = |part: &Part| -> u64 {
            let counts = [part.items.count(iteration, stats), stats.due, stats.movers, stats.moves];
            part.bytes.iter().zip(counts).map(|(bytes, count)| bytes * u64::from(count)).sum()
        };
        let items = self.parts[0].items;
        KernelWork {
            dispatches: 0,
            items: items.count(iteration, stats).into(),
            due: if items == Items::Listed { stats.due.into() } else { 0 },
            bytes: self.parts.iter().map(bytes).sum(),
        }
    }

    /// Whether only hierarchies need it.
    pub fn is_merging(&self) -> bool {
        self.parts.iter().any(|part| part.path.starts_with("merge/"))
    }

    /// Whether it has more storage buffers than portable devices bind.
    pub fn needs_many_buffers(&self) -> bool {
        self.bindings().len() > 8
    }

    /// Whether it is several kernels in one.
    pub fn is_chain(&self) -> bool {
        self.parts.len() > 1
    }

    /// The buffers of the bindings of group 1; group 0 has the [`Iteration`].
    pub fn bindings(&self) -> Vec<Binding> {
        let mut all: Vec<Binding> = Vec::new();
        let keys = [("reads", false), ("writes", true)];
        for (part, (key, is_written)) in self.parts.iter().flat_map(|part| keys.map(|key| (part, key))) {
            for name in names(part.wgsl, key) {
                // a name without a buffer leaves a source that does not parse; a test parses all
                let Some(&buffer) = Buffer::ALL.iter().find(|buffer| buffer.spec().name == name) else { continue };
                match all.iter_mut().find(|binding| binding.buffer == buffer) {
                    Some(binding) => binding.is_written |= is_written,
                    None => all.push(Binding { buffer, is_written }),
                }
            }
        }
        all
    }
}

/// The buffers that a flat clustering needs, or a hierarchy.
pub fn needed(is_merging: bool) -> Vec<Buffer> {
    let kernels = KERNELS.iter().filter(|kernel| is_merging || !kernel.is_merging());
    kernels.flat_map(|kernel| kernel.bindings()).map(|binding| binding.buffer).collect()
}

/// The most storage buffers that a kernel binds.
pub fn most_bound() -> usize {
    KERNELS.iter().map(|kernel| kernel.bindings().len()).max().unwrap_or(0)
}

/// The names that the first lines of a WGSL text have under a key.
pub fn names(wgsl: &'static str, key: &str) -> impl Iterator<Item = &'static str> {
    let head = wgsl.lines().map_while(|line| line.strip_prefix("//! ")).filter_map(|line| line.split_once(": "));
    let list = head.filter(|(found, _)| *found == key).map(|(_, list)| list).next().unwrap_or("");
    list.split(", ").filter(|name| !name.is_empty())
}

/// Appends a named text after the pieces that it uses, each once.
fn splice((name, wgsl): (&'static str, &'static str), used: &mut Vec<&'static str>, source: &mut String) {
    if used.contains(&name) {
        return;
    }
    used.push(name);
    // a name without a file leaves a source that does not parse; a test parses all
    let pieces = names(wgsl, "uses").filter_map(|name| PIECES.iter().find(|(piece, _)| *piece == name));
    pieces.for_each(|&piece| splice(piece, used, source));
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
    "append",
    "bids",
    "boundary_insert",
    "boundary_list",
    "candidate_edge",
    "cluster_sums",
    "copied_sums",
    "count",
    "due_faces",
    "energy_total",
    "float",
    "lengths",
    "ties",
    "wide",
}

/// Rows: name, file, a constant, items, bytes; then chains: name, rounds, kernels.
macro_rules! kernels {
    (
        $($name:ident = $path:literal $(($constant:literal = $value:literal))?, $items:ident $bytes:expr;)*
        { $($chain:ident = $rounds:literal * $($part:ident $(for $of:ident)?),+;)* }
    ) => {
        $(
            #[doc = concat!("`shaders/", $path, ".wgsl`")]
            pub const $name: &Kernel = &Kernel {
                name: stringify!($name),
                parts: &[Part {
                    path: $path,
                    wgsl: include_str!(concat!("../../../shaders/", $path, ".wgsl")),
                    items: Items::$items,
                    bytes: &$bytes,
                }],
                rounds: 1,
                constant: [$(Some(($constant, $value)),)? None][0],
            };
        )*
        $(
            #[doc = concat!($("`", stringify!($part), "` "),+)]
            pub const $chain: &Kernel = &Kernel {
                name: stringify!($chain),
                parts: &[$(Part { $(items: Items::$of,)? ..$part.parts[0] }),+],
                rounds: $rounds,
                constant: None,
            };
        )*

        /// All kernels.
        pub const KERNELS: &[&Kernel] = &[$($name,)* $($chain),*];
    };
}

kernels! {
    SUMS_GATHER = "sums/sums_gather", FaceRuns [25];
    PROXIES_FIT = "sums/proxies_fit", Clusters [80];

    LABELS_FREE = "growth/labels_free", Faces [8];
    GROWTH_PROPOSE = "growth/growth_propose", Listed [8, 0, 0, 88];
    GROWTH_APPLY = "growth/growth_apply", Listed [8, 0, 0, 8];

    BOUNDARY_BUILD = "boundary/boundary_keep", Faces [40];
    BOUNDARY_COMPACT = "boundary/boundary_keep", Listed [44];
    BOUNDARY_PROPOSE = "boundary/boundary_propose", Listed [12, 100, 16];
    BOUNDARY_APPLY = "boundary/boundary_apply", Movers [20, 0, 0, 140];

    FACE_BID = "refine/face_bid", Listed [12, 124, 56];
    SELECT_BIDS = "refine/select_bids", Movers [32];
    JOIN_MOVES = "refine/join_moves", Movers [20, 0, 0, 84];
    EVALUATE_MOVES = "refine/evaluate_moves", Movers [12, 0, 0, 240];
    COMMIT_MOVES = "refine/commit_moves", Movers [36, 0, 0, 16];

    PIECE_LINK = "pieces/piece_link", Faces [48];
    PIECE_UNION = "pieces/piece_union", Faces [50];
    PIECE_SIZE = "pieces/piece_size", FaceRuns [16];
    PIECE_SELECT_LARGEST = "pieces/piece_select_largest", Faces [4];
    PIECE_DETACH = "pieces/piece_detach", Faces [12];

    MIN_DUAL_EDGE_COST = "merge/min_dual_edge" ("PASS" = 0), Listed [92];
    MIN_DUAL_EDGE_TIE = "merge/min_dual_edge" ("PASS" = 1), Listed [104];
    MIN_DUAL_EDGE_OTHER = "merge/min_dual_edge" ("PASS" = 2), Listed [108];
    DUAL_EDGES_PUBLISH = "merge/dual_edges_publish", Clusters [24];
    CHEAPEST_DUAL_EDGE = "merge/cheapest_dual_edge", Listed [100];
    CHEAPEST_DUAL_EDGE_REDUCE = "merge/cheapest_dual_edge_reduce", EntriesAtOnce [32];
    MERGE_APPLY = "merge/merge_apply", Entries [188];
    MERGE_RELABEL = "merge/merge_relabel", Faces [12];
    MOVES_LIST = "merge/moves_list", Listed [12];
    SUMS_COPY = "merge/sums_copy", Entries [76];

    {
        BOUNDARY_CHAIN = 1 * BOUNDARY_APPLY, PROXIES_FIT;
        REFINEMENT_CHAIN = 1 * SELECT_BIDS, JOIN_MOVES, EVALUATE_MOVES, COMMIT_MOVES;
        REGROWTH_CHAIN = 3 * GROWTH_PROPOSE for Movers, GROWTH_APPLY for Movers;
    }
}
