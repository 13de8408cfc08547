//! uses: boundary_insert, cluster_sums, count
//! reads: faces, neighbours, wanted_clusters
//! writes: labels, clusters, stats, label_at_merge, boundary_list
// Second step of a pass of the boundary phase (P§3.2), a thread a listed face: the faces move, and their sums
// with them. If all faces want to leave a cluster, the smallest stays. Rust: device::plain::iterate.

fn boundary_apply(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face != FREE {
        let wanted = wanted_clusters[thread];
        if wanted != FREE {
            let own = labels[face];
            // complete since `boundary_propose`
            let is_last = atomicLoad(&clusters[own].staying) == 0u
                && atomicLoad(&clusters[own].first_leaver) == face;
            if !is_last {
                let sums = sums_of(faces[face]);
                add_to_cluster(own, sums_minus(NO_SUMS, sums), -1i);
                add_to_cluster(wanted, sums, 1i);
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
        }
    }
    write_inserted(local);
    let moves = counted_here(local);
    if moves != 0u {
        atomicAdd(&stats[iteration.slot].moves, moves);
        atomicStore(&boundary_list.moved_in, iteration.number);
    }
}
