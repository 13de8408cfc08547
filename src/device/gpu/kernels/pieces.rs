//! The kernels that look for pieces of clusters.

use super::*;

const PARENTS: Binding = binding("parents", Access::Write, 4);
const READ_PARENTS: Binding = binding("parents", Access::Read, 4);
const SIZES: Binding = binding("sizes", Access::Write, 4);

const PIECE_WGSL: &str = include_str!("../../../../shaders/shared/piece.wgsl");

/// Links faces with neighbours of their cluster.
pub const LINK: Kernel = Kernel {
    name: "piece_link",
    sources: &[TURN_WGSL, CLUSTER_WGSL, include_str!("../../../../shaders/pieces/piece_link.wgsl")],
    bindings: &[TURN, NEIGHBOURS, LABELS, CLUSTERS, PARENTS, SIZES],
    workgroup_size: WORKGROUP,
};

/// Joins what is linked.
pub const HOOK: Kernel = Kernel {
    name: "piece_union",
    sources: &[TURN_WGSL, PIECE_WGSL, include_str!("../../../../shaders/pieces/piece_union.wgsl")],
    bindings: &[TURN, NEIGHBOURS, LABELS, PARENTS],
    workgroup_size: WORKGROUP,
};

/// Counts their faces.
pub const WEIGH: Kernel = Kernel {
    name: "piece_size",
    sources: &[TURN_WGSL, MARKET_WGSL, PIECE_WGSL, include_str!("../../../../shaders/pieces/piece_size.wgsl")],
    bindings: &[TURN, LABELS, PARENTS, SIZES, MARKETS],
    workgroup_size: WORKGROUP,
};

/// Chooses the one that each cluster keeps.
pub const ELECT: Kernel = Kernel {
    name: "piece_select_largest",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        include_str!("../../../../shaders/pieces/piece_select_largest.wgsl"),
    ],
    bindings: &[TURN, LABELS, READ_PARENTS, binding("sizes", Access::Read, 4), MARKETS, CLUSTERS],
    workgroup_size: WORKGROUP,
};

/// Frees the faces of all others.
pub const CUT: Kernel = Kernel {
    name: "piece_detach",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        MARKET_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        ADD_WGSL,
        LISTS_WGSL,
        NEWCOMERS_WGSL,
        include_str!("../../../../shaders/pieces/piece_detach.wgsl"),
    ],
    bindings: &[TURN, READ_PARENTS, MARKETS, WRITTEN_LABELS, RING, FACES, CLUSTERS, ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};
