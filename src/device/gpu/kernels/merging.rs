//! The kernels of hierarchies.

use std::mem::size_of;

use super::*;
use crate::device::gpu::layout::Picked;

/// Optimal dual edges: finds the cheapest cost at each cluster.
pub const PRICE: Kernel = Kernel {
    name: "price",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        CHOICE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/price.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, CHOICES, LISTS],
    workgroup_size: WORKGROUP,
};

/// Optimal dual edges: finds the best tie among the cheapest.
pub const BREAK_TIES: Kernel = Kernel {
    name: "break_ties",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        CHOICE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/break_ties.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, CHOICES, LISTS],
    workgroup_size: WORKGROUP,
};

/// Optimal dual edges: finds the neighbour.
pub const PREFER: Kernel = Kernel {
    name: "prefer",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        CHOICE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/prefer.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, CHOICES, LISTS],
    workgroup_size: WORKGROUP,
};

/// Optimal dual edges: lists them.
pub const LIST_CHOICES: Kernel = Kernel {
    name: "list_choices",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        CHOICE_WGSL,
        FOUND_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/list_choices.wgsl"),
    ],
    bindings: &[TURN, CHOICES, FOUND, RING, LISTS],
    workgroup_size: WORKGROUP,
};

/// Cheapest dual edge: finds that of each workgroup's faces.
pub const SEARCH: Kernel = Kernel {
    name: "search",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        BEST_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/search.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, BESTS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Cheapest dual edge: finds that of all workgroups.
pub const REDUCE: Kernel = Kernel {
    name: "reduce",
    sources: &[TURN_WGSL, BEST_WGSL, LISTS_WGSL, include_str!("../../../../shaders/reduce.wgsl")],
    bindings: &[TURN, BESTS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Merge: adds up the sums of the pairs.
pub const UNITE: Kernel = Kernel {
    name: "unite",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        ADD_WGSL,
        SUMS_WGSL,
        include_str!("../../../../shaders/unite.wgsl"),
    ],
    bindings: &[TURN, ENTRIES, CLUSTERS, MERGED_INTO],
    workgroup_size: WORKGROUP,
};

/// Merge: brings the labels of all faces up to date.
pub const RELABEL: Kernel = Kernel {
    name: "relabel",
    sources: &[TURN_WGSL, include_str!("../../../../shaders/relabel.wgsl")],
    bindings: &[TURN, WRITTEN_LABELS, ORIGINS, binding("merged_into", Access::Read, 4)],
    workgroup_size: WORKGROUP,
};

/// Lists the faces that moved since the last merge.
pub const LIST_MOVES: Kernel = Kernel {
    name: "list_moves",
    sources: &[TURN_WGSL, SLOT_WGSL, FOUND_WGSL, LISTS_WGSL, include_str!("../../../../shaders/list_moves.wgsl")],
    bindings: &[TURN, LABELS, binding("origins", Access::Read, 4), FOUND, RING, LISTS],
    workgroup_size: WORKGROUP,
};

/// Copies the sums of some clusters.
pub const PICK_SUMS: Kernel = Kernel {
    name: "pick_sums",
    sources: &[TURN_WGSL, CLUSTER_WGSL, include_str!("../../../../shaders/pick_sums.wgsl")],
    bindings: &[TURN, ENTRIES, CLUSTERS, binding("picked", Access::Write, size_of::<Picked>())],
    workgroup_size: WORKGROUP,
};
