// What an iteration reports to the host. Rust: layout::IterationStats.
struct IterationStats {
    // Σ over clusters of the explained energy << shift, in refinement its rise, modulo 2¹²⁸: three 64-bit sums of
    // weight 1, 2³² and 2⁶⁴, low word first.
    explained: array<atomic<u32>, 6>,
    // Faces whose label changed.
    moves: atomic<u32>,
    // Faces that bid, in refinement.
    bids: atomic<u32>,
}
