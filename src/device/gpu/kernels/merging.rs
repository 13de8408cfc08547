//! The kernels of hierarchies.

use std::mem::size_of;

use super::*;
use crate::device::gpu::layout::Picked;

/// Optimal dual edges: finds the cheapest cost at each cluster.
pub const PRICE: Kernel = Kernel {
    name: "min_dual_edge_cost",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        CHOICE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/merge/min_dual_edge_cost.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, CHOICES, LISTS],
    workgroup_size: WORKGROUP,
};

/// Optimal dual edges: finds the best tie among the cheapest.
pub const BREAK_TIES: Kernel = Kernel {
    name: "min_dual_edge_tie",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        CHOICE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/merge/min_dual_edge_tie.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, CHOICES, LISTS],
    workgroup_size: WORKGROUP,
};

/// Optimal dual edges: finds the neighbour.
pub const PREFER: Kernel = Kernel {
    name: "min_dual_edge_other",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        CHOICE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/merge/min_dual_edge_other.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, CHOICES, LISTS],
    workgroup_size: WORKGROUP,
};

/// Optimal dual edges: lists them.
pub const LIST_CHOICES: Kernel = Kernel {
    name: "dual_edges_publish",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        CHOICE_WGSL,
        FOUND_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/merge/dual_edges_publish.wgsl"),
    ],
    bindings: &[TURN, CHOICES, FOUND, RING, LISTS],
    workgroup_size: WORKGROUP,
};

/// Cheapest dual edge: finds that of each workgroup's faces.
pub const SEARCH: Kernel = Kernel {
    name: "cheapest_dual_edge",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        SUMS_WGSL,
        BITS_WGSL,
        DUAL_EDGE_WGSL,
        BEST_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/merge/cheapest_dual_edge.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, LABELS, PROXIES, CLUSTERS, BESTS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Cheapest dual edge: finds that of all workgroups.
pub const REDUCE: Kernel = Kernel {
    name: "cheapest_dual_edge_reduce",
    sources: &[
        TURN_WGSL,
        BEST_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/merge/cheapest_dual_edge_reduce.wgsl"),
    ],
    bindings: &[TURN, BESTS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Merge: adds up the sums of the pairs.
pub const UNITE: Kernel = Kernel {
    name: "merge_apply",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        ADD_WGSL,
        SUMS_WGSL,
        include_str!("../../../../shaders/merge/merge_apply.wgsl"),
    ],
    bindings: &[TURN, ENTRIES, CLUSTERS, MERGED_INTO],
    workgroup_size: WORKGROUP,
};

/// Merge: brings the labels of all faces up to date.
pub const RELABEL: Kernel = Kernel {
    name: "merge_relabel",
    sources: &[TURN_WGSL, include_str!("../../../../shaders/merge/merge_relabel.wgsl")],
    bindings: &[TURN, WRITTEN_LABELS, ORIGINS, binding("merged_into", Access::Read, 4)],
    workgroup_size: WORKGROUP,
};

/// Lists the faces that moved since the last merge.
pub const LIST_MOVES: Kernel = Kernel {
    name: "moves_list",
    sources: &[TURN_WGSL, SLOT_WGSL, FOUND_WGSL, LISTS_WGSL, include_str!("../../../../shaders/merge/moves_list.wgsl")],
    bindings: &[TURN, LABELS, binding("origins", Access::Read, 4), FOUND, RING, LISTS],
    workgroup_size: WORKGROUP,
};

/// Copies the sums of some clusters.
pub const PICK_SUMS: Kernel = Kernel {
    name: "sums_copy",
    sources: &[TURN_WGSL, CLUSTER_WGSL, include_str!("../../../../shaders/merge/sums_copy.wgsl")],
    bindings: &[TURN, ENTRIES, CLUSTERS, binding("picked", Access::Write, size_of::<Picked>())],
    workgroup_size: WORKGROUP,
};
