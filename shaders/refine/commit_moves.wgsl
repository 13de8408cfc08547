//! uses: boundary_list, bids
//! reads: cluster_bids
//! writes: labels, face_bids, boundary_list
// Last step, a thread a mover: labels follow the moves that were accepted, and a refused winner stores the iteration.
// Rust: device::plain::try_moving.

fn commit_moves(face: u32) {
    let own = labels[face];
    if cluster_bids[own].won_in != iteration.number {
        return;
    }
    let accepted = cluster_bids[own].accepted;
    let has_won = cluster_bids[own].winner == face;
    let wanted = face_bids[face].wanted;
    if accepted == REFUSED {
        if has_won {
            face_bids[face].refused_in = iteration.number;
        }
    } else if wanted == cluster_bids[own].target_cluster && (accepted == ALL_MOVE || has_won) {
        labels[face] = wanted;
    }
}
