// Refinement (see cluster::refinement): what faces offer, and what becomes of it in each cluster.

// The bid of a face. Rust: layout::Offer.
struct Offer {
    // Where it wants to go, or FREE.
    cluster: u32,
    // Its packed gain.
    bid: u32,
    // The turn in which it was last refused, or 0.
    refused_in: u32,
}

// A cluster's place in the bidding. Rust: layout::Market.
struct Market {
    // The largest packed gain of the faces that want to leave or enter, 0 without any.
    best_bid: atomic<u32>,
    // The smallest face with that gain.
    best_face: atomic<u32>,
    // The turn in which a face last won a move from here.
    dealt_in: u32,
    // That face, where it wants to go, and what was decided.
    winner: u32,
    target_cluster: u32,
    verdict: u32,
    // The turn in which the cluster last gained or lost a face.
    changed_in: u32,
    unused: u32,
}

// The winner is refused, moves alone, or moves with all who want the same.
const REFUSED: u32 = 0u;
const WINNER_MOVES: u32 = 1u;
const ALL_MOVE: u32 = 2u;
