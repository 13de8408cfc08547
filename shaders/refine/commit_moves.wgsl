//! uses: boundary_list, bids
//! writes: labels, clusters, face_bids, cluster_bids, boundary_list
// Last step, a thread a mover: labels follow the moves that were accepted, a refused winner loses its bid, and the
// clusters are ready for the next bids. Rust: device::plain::try_moving.

fn clear_bids(cluster: u32) {
    atomicStore(&cluster_bids[cluster].best_bid, 0u);
    atomicStore(&cluster_bids[cluster].best_face, FREE);
}

fn commit_moves(face: u32) {
    let own = labels[face];
    let wanted = face_bids[face].wanted;
    atomicMax(&clusters[own].active_in, 2u * iteration.number);
    clear_bids(own);
    clear_bids(wanted);
    if cluster_bids[own].won_in != iteration.number {
        return;
    }
    let accepted = cluster_bids[own].accepted;
    let has_won = cluster_bids[own].winner == face;
    if accepted == REFUSED {
        if has_won {
            face_bids[face].bid = 0u;
        }
    } else if wanted == cluster_bids[own].target_cluster && (accepted == ALL_MOVE || has_won) {
        labels[face] = wanted;
    }
}
