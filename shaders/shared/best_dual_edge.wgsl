// The best dual edge of a cluster so far, all numbers inverted: cleared memory is worse than any edge, and the larger
// number is the better one. Rust: layout::BestDualEdge.
struct BestDualEdge {
    // The packed cost; 0 without an edge, as no edge has that.
    cost: atomic<u32>,
    // The smallest tie of the edges with that cost.
    tie: atomic<u32>,
    // The smallest neighbour of those.
    other: atomic<u32>,
}
