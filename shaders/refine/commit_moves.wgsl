//! uses: boundary_list, bids
//! writes: labels, face_bids, cluster_bids, boundary_list
// Last step, a thread a listed face: labels follow the accepted moves, and a refused winner stores the iteration.
// Rust: device::plain::try_moving.

fn commit_moves(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face == FREE {
        return;
    }
    let wanted = face_bids[face].cluster;
    if wanted == FREE {
        return;
    }
    let own = labels[face];
    if cluster_bids[own].won_in != iteration.number || cluster_bids[own].target_cluster != wanted {
        return;
    }
    let accepted = cluster_bids[own].accepted;
    let is_winner = cluster_bids[own].winner == face;
    if accepted == ALL_MOVE || (accepted == WINNER_MOVES && is_winner) {
        labels[face] = wanted;
    } else if accepted == REFUSED && is_winner {
        face_bids[face].refused_in = iteration.number;
    }
}
