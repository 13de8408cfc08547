// What dispatches go over: the faces on boundaries, and the clusters that are left. Rust: layout::Lists.
//
// Every face is listed that has a neighbour of another cluster, or is free; others may be.
struct Lists {
    // Faces that are listed, those included that a kernel adds while it runs.
    length: atomic<u32>,
    // Faces that have come through `boundary_build` or `boundary_compact`.
    kept: atomic<u32>,
    // Faces that dispatches go over until the next time that they are counted.
    due: u32,
    // Where in `entries` they are: the first half is in use, or the second.
    first: u32,
    // Two times as many as there are faces, and then clusters.
    entries: array<u32>,
}

// The face of a thread, or FREE.
fn listed_face(thread: u32) -> u32 {
    if thread >= lists.due {
        return FREE;
    }
    return lists.entries[lists.first + thread];
}

// The cluster of a thread, or FREE.
fn living_cluster(thread: u32) -> u32 {
    if thread >= turn.clusters {
        return FREE;
    }
    return lists.entries[2u * turn.faces + thread];
}
