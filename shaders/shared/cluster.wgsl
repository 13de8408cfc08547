// Sums over the faces of a cluster, and its leavers of this iteration. Rust: layout::Cluster.
struct Cluster {
    // Σ weight·centroid, one 64-bit number an axis, low word first, two's complement.
    moment: array<atomic<u32>, 6>,
    // Σ weight, 64 bits, low word first.
    weight: array<atomic<u32>, 2>,
    // Number of faces.
    count: atomic<u32>,
    // Faces that belonged to the cluster when the iteration began and do not want to leave.
    staying: atomic<u32>,
    // Smallest face that wants to leave.
    first_leaver: atomic<u32>,
    // 1: known to be connected, and it has lost no face since.
    connected: atomic<u32>,
}
