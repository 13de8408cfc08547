//! The kernels that look for pieces of clusters: among all faces, and in hierarchies among the listed ones.

use super::*;

const PARENTS: Binding = binding("parents", Access::Write, 4);
const READ_PARENTS: Binding = binding("parents", Access::Read, 4);
const SIZES: Binding = binding("sizes", Access::Write, 4);
const READ_SIZES: Binding = binding("sizes", Access::Read, 4);
const READ_ORIGINS: Binding = binding("origins", Access::Read, 4);

const PIECE_WGSL: &str = include_str!("../../../../shaders/shared/piece.wgsl");
const OPEN_WGSL: &str = include_str!("../../../../shaders/shared/open.wgsl");

/// In a hierarchy: lists the faces around those that moved.
pub const EXPLORE: Kernel = Kernel {
    name: "explore",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        LISTS_WGSL,
        MERGED_WGSL,
        AROUND_WGSL,
        NEWCOMERS_WGSL,
        include_str!("../../../../shaders/explore.wgsl"),
    ],
    bindings: &[TURN, NEIGHBOURS, WRITTEN_LABELS, CLUSTERS, ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Links faces with neighbours of their cluster.
pub const LINK: Kernel = Kernel {
    name: "link",
    sources: &[TURN_WGSL, CLUSTER_WGSL, OPEN_WGSL, LISTS_WGSL, include_str!("../../../../shaders/link.wgsl")],
    bindings: &[TURN, NEIGHBOURS, LABELS, CLUSTERS, PARENTS, SIZES, READ_ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Joins what is linked.
pub const HOOK: Kernel = Kernel {
    name: "hook",
    sources: &[TURN_WGSL, PIECE_WGSL, LISTS_WGSL, include_str!("../../../../shaders/hook.wgsl")],
    bindings: &[TURN, NEIGHBOURS, binding("cluster_of_face", Access::Read, 4), PARENTS, READ_ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Counts their faces.
pub const WEIGH: Kernel = Kernel {
    name: "weigh",
    sources: &[
        TURN_WGSL,
        MARKET_WGSL,
        PIECE_WGSL,
        OPEN_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/weigh.wgsl"),
    ],
    bindings: &[TURN, LABELS, PARENTS, SIZES, MARKETS, LISTS],
    workgroup_size: WORKGROUP,
};

/// In a hierarchy: tells the clusters of those that are known whole.
pub const TALLY: Kernel = Kernel {
    name: "tally",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        OPEN_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/tally.wgsl"),
    ],
    bindings: &[TURN, LABELS, READ_PARENTS, READ_SIZES, MARKETS, CLUSTERS, LISTS],
    workgroup_size: WORKGROUP,
};

/// In a hierarchy: finds the gaps that faces left.
pub const MARK_GAPS: Kernel = Kernel {
    name: "mark_gaps",
    sources: &[TURN_WGSL, CLUSTER_WGSL, OPEN_WGSL, LISTS_WGSL, include_str!("../../../../shaders/mark_gaps.wgsl")],
    bindings: &[TURN, LABELS, READ_ORIGINS, READ_PARENTS, SIZES, CLUSTERS, binding("gaps", Access::Write, 4), LISTS],
    workgroup_size: WORKGROUP,
};

/// In a hierarchy: finds whether listed faces tell enough.
pub const DOUBT: Kernel = Kernel {
    name: "doubt",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        OPEN_WGSL,
        PIECE_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/doubt.wgsl"),
    ],
    bindings: &[
        TURN,
        NEIGHBOURS,
        LABELS,
        READ_ORIGINS,
        binding("pieces", Access::Read, 4),
        SIZES,
        PARENTS,
        CLUSTERS,
        LISTS,
    ],
    workgroup_size: WORKGROUP,
};

/// In a hierarchy: lets all faces be looked at where they do not.
pub const DECIDE: Kernel = Kernel {
    name: "decide",
    sources: &[TURN_WGSL, MARKET_WGSL, LISTS_WGSL, COVER_WGSL, include_str!("../../../../shaders/decide.wgsl")],
    bindings: &[TURN, MARKETS, NEXT_DISPATCH, binding("second_search", Access::Write, size_of::<Dispatch>()), LISTS],
    workgroup_size: WORKGROUP,
};

/// Chooses the one that each cluster keeps.
pub const ELECT: Kernel = Kernel {
    name: "elect",
    sources: &[
        TURN_WGSL,
        CLUSTER_WGSL,
        MARKET_WGSL,
        OPEN_WGSL,
        LISTS_WGSL,
        include_str!("../../../../shaders/elect.wgsl"),
    ],
    bindings: &[TURN, LABELS, PARENTS, READ_SIZES, MARKETS, CLUSTERS, LISTS],
    workgroup_size: WORKGROUP,
};

/// Frees the faces of all others.
pub const CUT: Kernel = Kernel {
    name: "cut",
    sources: &[
        TURN_WGSL,
        SLOT_WGSL,
        MARKET_WGSL,
        CLUSTER_WGSL,
        FACE_WGSL,
        ADD_WGSL,
        LISTS_WGSL,
        NEWCOMERS_WGSL,
        include_str!("../../../../shaders/cut.wgsl"),
    ],
    bindings: &[TURN, READ_PARENTS, MARKETS, WRITTEN_LABELS, RING, FACES, CLUSTERS, ORIGINS, LISTS],
    workgroup_size: WORKGROUP,
};
