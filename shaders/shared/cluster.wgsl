// The sums of a cluster, and who wants to leave it. Rust: layout::Cluster.
struct Cluster {
    // Σ weight·centroid, one 64-bit number an axis, low word first, two's complement.
    sum: array<atomic<u32>, 6>,
    // Σ weight, 64 bits, low word first.
    weight: array<atomic<u32>, 2>,
    // Number of faces.
    count: atomic<u32>,
    // Faces that the cluster had at the start of the iteration and that do not want to leave.
    staying: atomic<u32>,
    // Smallest face that wants to leave.
    first_leaver: atomic<u32>,
    // 1: known to be in one piece; it has lost no face since.
    whole: atomic<u32>,
}
