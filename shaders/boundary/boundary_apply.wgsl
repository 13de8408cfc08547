//! uses: boundary_insert, cluster_sums, count
//! reads: faces, neighbours, wanted_clusters
//! writes: labels, clusters, stats, label_at_merge, boundary_list
// Second step of a pass of the boundary phase (P§3.2), a thread a mover: the faces move, and their sums with them. If
// all faces want to leave a cluster, the smallest stays. Rust: device::plain::iterate.

fn boundary_apply(face: u32) {
    let own = labels[face];
    // complete since `boundary_propose`
    if atomicLoad(&clusters[own].staying) == 0u && atomicLoad(&clusters[own].first_leaver) == face {
        return;
    }
    let wanted = wanted_clusters[face];
    let sums = sums_of(faces[face]);
    add_to_cluster(own, sums_minus(NO_SUMS, sums), -1i);
    add_to_cluster(wanted, sums, 1i);
    atomicStore(&clusters[own].active_in, 2u * iteration.number + 1u);
    atomicStore(&clusters[wanted].active_in, 2u * iteration.number + 1u);
    atomicStore(&clusters[own].connected, 0u);
    labels[face] = wanted;
    atomicAdd(&counted, 1u);
    // neighbours inside `own` are on the boundary now
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        if claim(neighbours[at], own) {
            insert(neighbours[at]);
        }
    }
}

fn boundary_apply_end(local: u32, group: u32) {
    write_inserted(local);
    if add_moves(local) != 0u {
        atomicStore(&boundary_list.moved_in, iteration.number);
    }
}
