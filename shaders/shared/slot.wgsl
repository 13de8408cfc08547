// What a turn leaves for the host. Rust: layout::Slot.
struct Slot {
    // Σ (2·P·S − M·|P|²) << shift, in refinement what it rose by, modulo 2¹²⁸: three 64-bit sums, low word first, that
    // count 1, 2³² and 2⁶⁴.
    explained: array<atomic<u32>, 6>,
    // Faces whose label changed.
    moves: atomic<u32>,
    // Faces that bid, in refinement.
    bids: atomic<u32>,
}
