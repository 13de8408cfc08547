// The best dual edge of a cluster so far, all numbers inverted: cleared memory is worse than any edge, and the larger number
// is the better one. Rust: layout::Choice.
struct Choice {
    // The packed cost; 0, which no edge has, without any.
    cost: atomic<u32>,
    // Of the edges with that cost, the tie.
    tie: atomic<u32>,
    // Of those, the neighbour.
    other: atomic<u32>,
}
