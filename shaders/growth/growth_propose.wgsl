//! uses: boundary_list, cluster_sums, count
//! reads: faces, neighbours, labels
//! writes: wanted_clusters, clusters, stats, boundary_list
// First step of a pass of the growth (P§5.3), a thread a listed face: a free face with labelled neighbours chooses the
// smallest of their labels. Every free face is listed. Rust: device::plain::grow.

fn growth_propose(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face != FREE {
        var label = FREE;
        if labels[face] == FREE {
            let end = neighbours[face + 1u];
            for (var at = neighbours[face]; at < end; at++) {
                label = min(label, labels[neighbours[at]]);
            }
            if label != FREE {
                atomicAdd(&counted, 1u);
                add_to_cluster(label, sums_of(faces[face]), 1i);
            }
        }
        wanted_clusters[thread] = label;
    }
    add_moves(local);
}
