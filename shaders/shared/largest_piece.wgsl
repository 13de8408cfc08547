// The piece that a cluster keeps; cleared memory is no piece. Rust: layout::LargestPiece.
struct LargestPiece {
    // Number of its faces.
    size: atomic<u32>,
    // Its smallest face, inverted, so that the maximum finds the smallest.
    inverted_root: atomic<u32>,
}
