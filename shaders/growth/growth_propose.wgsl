//! uses: boundary_list, cluster_sums, count
//! reads: faces, neighbours, labels
//! writes: wanted_clusters, clusters, stats, boundary_list
// First step of a pass of the growth (P§5.3), a thread a listed face or a freed one: a free face with labelled
// neighbours chooses the smallest of their labels. Every free face is listed. Rust: device::plain::grow.

fn growth_propose(face: u32) {
    if labels[face] != FREE {
        return;
    }
    var label = FREE;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        label = min(label, labels[neighbours[at]]);
    }
    if label != FREE {
        atomicAdd(&counted, 1u);
        add_to_cluster(label, sums_of(faces[face]), 1i);
    }
    wanted_clusters[face] = label;
}

fn growth_propose_end(local: u32, group: u32) {
    add_moves(local);
}
