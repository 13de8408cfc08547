//! uses: boundary_insert, energy
//! reads: faces, neighbours, labels
//! writes: face_bids, cluster_bids, label_at_merge, boundary_list
// Third step, a thread a mover: a face that both its clusters took wins, and faces that want the same move join it.
// Their sums are added up at the cluster that they leave. Rust: device::plain::winners.

fn add_to_joining_sum(cluster: u32, at: u32, value: i64) {
    let low = u32(u64(value) & 0xfffffffflu);
    let before = atomicAdd(&cluster_bids[cluster].joining_sums[2u * at], low);
    let high = u32(u64(value) >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&cluster_bids[cluster].joining_sums[2u * at + 1u], high);
    }
}

// Adds a face to the sums of those that leave a cluster together, as `cluster_sums` adds to a cluster.
fn add_joining(cluster: u32, sums: Sums) {
    @each(add_to_joining_sum(cluster, #u, sums[#]);)
    atomicAdd(&cluster_bids[cluster].joining, 1u);
}

// Adds a face to the move of its cluster's winner, if it wants the same. Its neighbours inside the cluster are listed
// before the move is accepted.
fn join_moves(face: u32) {
    let wanted = face_bids[face].wanted;
    let own = labels[face];
    let winner = atomicLoad(&cluster_bids[own].best_face);
    // a face that both clusters took moves between the two, but maybe in the other direction
    if winner != atomicLoad(&cluster_bids[wanted].best_face) || winner == FREE || labels[winner] != own {
        return;
    }
    if winner == face {
        cluster_bids[own].won_in = iteration.number;
        cluster_bids[own].winner = face;
        cluster_bids[own].target_cluster = wanted;
    }
    add_joining(own, sums_of(faces[face]));
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if claim(near, own) {
            // of an earlier phase
            face_bids[near].bid = 0u;
            insert(near);
        }
    }
}

fn join_moves_end(local: u32, group: u32) {
    write_inserted(local);
}
