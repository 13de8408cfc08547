// What dispatches go over: the faces on boundaries, and the clusters that are left. Rust: layout::Lists.
//
// Every face is listed that has a neighbour of another cluster, or is free; others may be. The labels of listed faces and of
// those beside them are up to date; others may name a cluster that has become part of another.
struct Lists {
    // Faces that are listed, those included that a kernel adds while it runs.
    length: atomic<u32>,
    // Faces that have come through `enlist` or `weed`.
    kept: atomic<u32>,
    // Faces that dispatches go over until the next time that they are counted.
    due: u32,
    // Where in `entries` they are: the first half is in use, or the second.
    first: u32,
    // 1: labels of other faces than these may not be up to date.
    behind: u32,
    // 1: the search for pieces goes over all faces, not over the listed ones.
    everywhere: u32,
    // 1: looking at listed faces does not tell the pieces.
    doubts: atomic<u32>,
    // Two times as many as there are faces, and then clusters. In hierarchies those have as much room as faces, and then comes,
    // for each cluster, 0 or one more than the one it became part of.
    entries: array<u32>,
}

// The face of a thread, or FREE.
fn listed_face(thread: u32) -> u32 {
    if thread >= lists.due {
        return FREE;
    }
    return lists.entries[lists.first + thread];
}

// The face of a thread of the search for pieces, or FREE.
fn searched_face(thread: u32) -> u32 {
    if lists.everywhere == 0u {
        return listed_face(thread);
    }
    return select(FREE, thread, thread < turn.faces);
}

// The cluster of a thread, or FREE.
fn living_cluster(thread: u32) -> u32 {
    if thread >= turn.clusters {
        return FREE;
    }
    return lists.entries[2u * turn.faces + thread];
}
