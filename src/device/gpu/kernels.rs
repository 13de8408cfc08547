//! The table of kernels: one WGSL file in `shaders/`, one entry here. `tests/shader_layout.rs` compares it with what the
//! shaders declare.

use std::mem::size_of;

mod merging;
mod pieces;

use super::layout::{Best, Choice, Cluster, Dispatch, Face, Found, Lists, Market, Offer, Proxy, Slot, Turn, WORKGROUP};
pub use merging::*;
pub use pieces::*;

/// A compute shader with one entry point of the same name.
#[derive(Debug)]
pub struct Kernel {
    /// Name of the file in `shaders/`, of the entry point, and for error messages.
    pub name: &'static str,
    /// Files of `shaders/shared` that are prepended, then its own file.
    pub sources: &'static [&'static str],
    /// Its bindings in group 0, numbered from 0.
    pub bindings: &'static [Binding],
    /// Threads in a workgroup.
    pub workgroup_size: u32,
}

impl Kernel {
    /// The whole WGSL source.
    pub fn source(&self) -> String {
        self.sources.join("\n")
    }
}

/// One buffer that a kernel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// Name of the variable.
    pub name: &'static str,
    /// How the kernel uses it.
    pub access: Access,
    /// Bytes of an element of the array, or of the one value.
    pub stride: usize,
}

/// How a kernel uses a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// A uniform, at an offset that each dispatch chooses.
    Turn,
    /// Storage that is read.
    Read,
    /// Storage that is read and written.
    Write,
}

const fn binding(name: &'static str, access: Access, stride: usize) -> Binding {
    Binding { name, access, stride }
}

const TURN: Binding = binding("turn", Access::Turn, size_of::<Turn>());
const FACES: Binding = binding("faces", Access::Read, size_of::<Face>());
const NEIGHBOURS: Binding = binding("neighbours", Access::Read, 4);
const LABELS: Binding = binding("labels", Access::Read, 4);
const WRITTEN_LABELS: Binding = binding("labels", Access::Write, 4);
const PROXIES: Binding = binding("proxies", Access::Read, size_of::<Proxy>());
const CLUSTERS: Binding = binding("clusters", Access::Write, size_of::<Cluster>());
const MARKETS: Binding = binding("markets", Access::Write, size_of::<Market>());
const RING: Binding = binding("ring", Access::Write, size_of::<Slot>());
const CHOICES: Binding = binding("choices", Access::Write, size_of::<Choice>());
const FOUND: Binding = binding("found", Access::Write, size_of::<Found>());
const BESTS: Binding = binding("bests", Access::Write, size_of::<Best>());
const ENTRIES: Binding = binding("entries", Access::Read, 4);
const LISTS: Binding = binding("lists", Access::Write, size_of::<Lists>());
const MERGED_INTO: Binding = binding("merged_into", Access::Write, 4);
const ORIGINS: Binding = binding("origins", Access::Write, 4);
const NEXT_DISPATCH: Binding = binding("next_dispatch", Access::Write, size_of::<Dispatch>());

const TURN_WGSL: &str = include_str!("../../../shaders/shared/turn.wgsl");
const SLOT_WGSL: &str = include_str!("../../../shaders/shared/slot.wgsl");
const CLUSTER_WGSL: &str = include_str!("../../../shaders/shared/cluster.wgsl");
const LISTS_WGSL: &str = include_str!("../../../shaders/shared/lists.wgsl");
const COVER_WGSL: &str = include_str!("../../../shaders/shared/cover.wgsl");
const KEEP_WGSL: &str = include_str!("../../../shaders/shared/keep.wgsl");
const NEWCOMERS_WGSL: &str = include_str!("../../../shaders/shared/newcomers.wgsl");
const MARKET_WGSL: &str = include_str!("../../../shaders/shared/market.wgsl");
const FACE_WGSL: &str = include_str!("../../../shaders/shared/face.wgsl");
const ADD_WGSL: &str = include_str!("../../../shaders/shared/add.wgsl");
const SUMS_WGSL: &str = include_str!("../../../shaders/shared/sums.wgsl");
const BITS_WGSL: &str = include_str!("../../../shaders/shared/bits.wgsl");
const DUAL_EDGE_WGSL: &str = include_str!("../../../shaders/shared/dual_edge.wgsl");
const CHOICE_WGSL: &str = include_str!("../../../shaders/shared/choice.wgsl");
const FOUND_WGSL: &str = include_str!("../../../shaders/shared/found.wgsl");
const BEST_WGSL: &str = include_str!("../../../shaders/shared/best.wgsl");
const ENERGY_WGSL: &str = include_str!("../../../shaders/shared/energy.wgsl");

/// Grows the clusters by one ring of faces.
pub const GROW: Kernel = Kernel {
    name: "growth_propose",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        ADD_WGSL,
        LISTS_WGSL,
        include_str!("../../../shaders/growth/growth_propose.wgsl"),
    ],
    bindings: &[
        TURN,
        NEIGHBOURS,
        binding("labels_before", Access::Read, 4),
        binding("labels_after", Access::Write, 4),
        RING,
        LISTS,
        FACES,
        CLUSTERS,
    ],
    workgroup_size: WORKGROUP,
};

/// Ends the growth when a pass changed nothing.
pub const SETTLE: Kernel = Kernel {
    name: "growth_check_done",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        LISTS_WGSL,
        COVER_WGSL,
        include_str!("../../../shaders/growth/growth_check_done.wgsl"),
    ],
    bindings: &[TURN, RING, LISTS, NEXT_DISPATCH],
    workgroup_size: 1,
};

/// Lists the faces on boundaries.
pub const ENLIST: Kernel = Kernel {
    name: "boundary_build",
    sources: &[TURN_WGSL, LISTS_WGSL, KEEP_WGSL, include_str!("../../../shaders/boundary/boundary_build.wgsl")],
    bindings: &[TURN, NEIGHBOURS, LABELS, ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Takes those off the list that no longer are on one.
pub const WEED: Kernel = Kernel {
    name: "boundary_compact",
    sources: &[TURN_WGSL, LISTS_WGSL, KEEP_WGSL, include_str!("../../../shaders/boundary/boundary_compact.wgsl")],
    bindings: &[TURN, NEIGHBOURS, LABELS, ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Takes the new list into use.
pub const LINE_UP: Kernel = Kernel {
    name: "boundary_publish",
    sources: &[TURN_WGSL, LISTS_WGSL, COVER_WGSL, include_str!("../../../shaders/boundary/boundary_publish.wgsl")],
    bindings: &[TURN, LISTS, NEXT_DISPATCH],
    workgroup_size: 1,
};

/// Sums up the clusters.
pub const GATHER: Kernel = Kernel {
    name: "sums_gather",
    sources: &[TURN_WGSL, CLUSTER_WGSL, FACE_WGSL, ADD_WGSL, include_str!("../../../shaders/sums/sums_gather.wgsl")],
    bindings: &[TURN, FACES, LABELS, CLUSTERS],
    workgroup_size: WORKGROUP,
};

/// Boundary phase: finds the faces that want to move.
pub const PROPOSE: Kernel = Kernel {
    name: "boundary_propose",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        LISTS_WGSL,
        include_str!("../../../shaders/boundary/boundary_propose.wgsl"),
    ],
    bindings: &[TURN, FACES, NEIGHBOURS, LABELS, PROXIES, binding("wishes", Access::Write, 4), CLUSTERS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Boundary phase: moves them.
pub const APPLY: Kernel = Kernel {
    name: "boundary_apply",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        ADD_WGSL,
        LISTS_WGSL,
        NEWCOMERS_WGSL,
        include_str!("../../../shaders/boundary/boundary_apply.wgsl"),
    ],
    bindings: &[
        TURN,
        FACES,
        binding("wishes", Access::Read, 4),
        WRITTEN_LABELS,
        CLUSTERS,
        RING,
        NEIGHBOURS,
        ORIGINS,
        LISTS,
    ],
    workgroup_size: WORKGROUP,
};

/// Boundary phase: fits the proxies and measures the energy.
pub const FIT: Kernel = Kernel {
    name: "proxies_fit",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        SUMS_WGSL,
        ENERGY_WGSL,
        LISTS_WGSL,
        COVER_WGSL,
        include_str!("../../../shaders/sums/proxies_fit.wgsl"),
    ],
    bindings: &[
        TURN,
        CLUSTERS,
        binding("proxies", Access::Write, size_of::<Proxy>()),
        MARKETS,
        RING,
        NEXT_DISPATCH,
        LISTS,
    ],
    workgroup_size: WORKGROUP,
};

/// Refinement: lets every face bid.
pub const BID: Kernel = Kernel {
    name: "face_bid",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        LISTS_WGSL,
        include_str!("../../../shaders/refine/face_bid.wgsl"),
    ],
    bindings: &[
        TURN,
        FACES,
        NEIGHBOURS,
        LABELS,
        PROXIES,
        CLUSTERS,
        MARKETS,
        binding("offers", Access::Write, size_of::<Offer>()),
        LISTS,
    ],
    workgroup_size: WORKGROUP,
};

/// Refinement: finds the best bid at each cluster.
pub const CHOOSE: Kernel = Kernel {
    name: "select_bids",
    sources: &[TURN_WGSL, SLOT_WGSL, MARKET_WGSL, LISTS_WGSL, include_str!("../../../shaders/refine/select_bids.wgsl")],
    bindings: &[TURN, LABELS, binding("offers", Access::Read, size_of::<Offer>()), MARKETS, RING, LISTS],
    workgroup_size: WORKGROUP,
};

/// Refinement: finds who wins and who joins.
pub const JOIN: Kernel = Kernel {
    name: "join_moves",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        FACE_WGSL,
        ADD_WGSL,
        LISTS_WGSL,
        NEWCOMERS_WGSL,
        include_str!("../../../shaders/refine/join_moves.wgsl"),
    ],
    bindings: &[
        TURN,
        FACES,
        LABELS,
        binding("offers", Access::Write, size_of::<Offer>()),
        MARKETS,
        CLUSTERS,
        NEIGHBOURS,
        ORIGINS,
        LISTS,
    ],
    workgroup_size: WORKGROUP,
};

/// Refinement: decides, and brings sums and proxies up to date.
pub const JUDGE: Kernel = Kernel {
    name: "evaluate_moves",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        ENERGY_WGSL,
        LISTS_WGSL,
        COVER_WGSL,
        include_str!("../../../shaders/refine/evaluate_moves.wgsl"),
    ],
    bindings: &[
        TURN,
        FACES,
        CLUSTERS,
        binding("joining", Access::Write, size_of::<Cluster>()),
        binding("proxies", Access::Write, size_of::<Proxy>()),
        MARKETS,
        RING,
        NEXT_DISPATCH,
        LISTS,
    ],
    workgroup_size: WORKGROUP,
};

/// Refinement: brings the labels up to date.
pub const DEAL: Kernel = Kernel {
    name: "commit_moves",
    sources: &[TURN_WGSL, MARKET_WGSL, LISTS_WGSL, include_str!("../../../shaders/refine/commit_moves.wgsl")],
    bindings: &[TURN, WRITTEN_LABELS, binding("offers", Access::Write, size_of::<Offer>()), MARKETS, LISTS],
    workgroup_size: WORKGROUP,
};

/// All kernels.
pub const KERNELS: &[&Kernel] = &[
    &GROW,
    &SETTLE,
    &ENLIST,
    &WEED,
    &LINE_UP,
    &GATHER,
    &PROPOSE,
    &APPLY,
    &FIT,
    &BID,
    &CHOOSE,
    &JOIN,
    &JUDGE,
    &DEAL,
    &LINK,
    &HOOK,
    &WEIGH,
    &ELECT,
    &CUT,
    &PRICE,
    &BREAK_TIES,
    &PREFER,
    &LIST_CHOICES,
    &SEARCH,
    &REDUCE,
    &UNITE,
    &RELABEL,
    &LIST_MOVES,
    &PICK_SUMS,
];
