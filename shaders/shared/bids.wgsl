// Refinement (cluster::refinement): the bids of faces and what clusters make of them.

// The best move of a face. Rust: layout::FaceBid.
struct FaceBid {
    // The cluster that it wants to enter, or FREE.
    cluster: u32,
    // The packed gain.
    bid: u32,
    // The iteration in which the face was last refused, or 0.
    refused_in: u32,
}

// The bids at a cluster, and the move that leaves it. Rust: layout::ClusterBids.
struct ClusterBids {
    // The largest packed gain of the faces that want to leave or enter, 0 without any.
    best_bid: atomic<u32>,
    // The smallest face with that gain.
    best_face: atomic<u32>,
    // The iteration in which a face last won a move out of this cluster, that face, and the cluster that it wants to
    // enter.
    won_in: u32,
    winner: u32,
    target_cluster: u32,
    // What was decided: REFUSED, WINNER_MOVES or ALL_MOVE.
    accepted: u32,
    // The iteration in which the cluster last gained or lost a face.
    changed_in: u32,
    unused: u32,
}

// The winner is refused, moves alone, or moves with all faces that want the same move.
const REFUSED: u32 = 0u;
const WINNER_MOVES: u32 = 1u;
const ALL_MOVE: u32 = 2u;
