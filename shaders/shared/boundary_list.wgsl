//! uses: iteration
// The lists that dispatches go over: boundary faces, and the clusters that are left. Rust: layout::BoundaryList.
//
// Every free face and every face with a neighbour of another cluster is listed; others may be.
struct BoundaryList {
    // Listed faces, with those that kernels have added during this dispatch.
    length: atomic<u32>,
    // Faces that `boundary_build` or `boundary_compact` has kept so far.
    kept: atomic<u32>,
    // Listed faces that dispatches go over: `length` when `cover_list` ran last.
    due: u32,
    // Index in `entries` of the first listed face: 0 or the number of faces.
    first: u32,
    // Two halves of one entry a face, of which one is in use; then the clusters that are left. One buffer, because
    // portable devices bind 8.
    entries: array<u32>,
}

// The face of a thread, or FREE.
fn listed_face(thread: u32) -> u32 {
    if thread >= boundary_list.due {
        return FREE;
    }
    return boundary_list.entries[boundary_list.first + thread];
}

// The cluster of a thread, or FREE.
fn living_cluster(thread: u32) -> u32 {
    if thread >= iteration.clusters {
        return FREE;
    }
    return boundary_list.entries[2u * iteration.faces + thread];
}
