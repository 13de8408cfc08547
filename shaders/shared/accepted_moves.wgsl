//! uses: bids
// The moves that an iteration of the refinement accepted. `labels` do not have them yet when the next iteration begins:
// `face_bid` computes the labels that it needs, and `select_bids` stores them, which saves a dispatch an iteration;
// `commit_moves` stores those of the last iteration of a batch.
//
// A label that is stored already is its own result: a cluster that a face enters loses none in the same iteration, so
// `won_in` of the new label is the number of another one. A face that is not listed has no bid.

// The label of a face after the moves of iteration `number`; 0 is before all.
fn label_after(face: u32, number: u32) -> u32 {
    let label = labels[face];
    if number == 0u || label == FREE || cluster_bids[label].won_in != number {
        return label;
    }
    let wanted = face_bids[face].wanted_in[number & 1u];
    let accepted = cluster_bids[label].accepted;
    let moves = wanted == cluster_bids[label].target_cluster
        && (accepted == ALL_MOVE || (accepted == WINNER_MOVES && cluster_bids[label].winner == face));
    return select(label, wanted, moves);
}

// Whether a face of this cluster won in iteration `number`, and was refused.
fn is_refused(face: u32, label: u32, number: u32) -> bool {
    return number != 0u && label != FREE && cluster_bids[label].won_in == number
        && cluster_bids[label].winner == face && cluster_bids[label].accepted == REFUSED;
}
