//! uses: boundary_list, accepted_moves
//! writes: labels, face_bids, cluster_bids, boundary_list
// After a batch, a thread a listed face: labels follow the moves that its last iteration accepted, and a refused winner
// stores the iteration. Rust: device::plain::try_moving.

fn commit_moves(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face == FREE {
        return;
    }
    let label = label_after(face, iteration.number);
    if is_refused(face, label, iteration.number) {
        face_bids[face].refused_in = iteration.number;
    }
    labels[face] = label;
}
