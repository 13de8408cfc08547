//! uses: boundary_list
//! reads: labels, face_bids
//! writes: cluster_bids, boundary_list
// Second step, a thread a mover: each cluster takes the smallest face of those with its best bid. Rust:
// device::plain::winners.

fn select_bid(cluster: u32, face: u32, bid: u32) {
    if atomicLoad(&cluster_bids[cluster].best_bid) == bid {
        atomicMin(&cluster_bids[cluster].best_face, face);
    }
}

fn select_bids(face: u32) {
    let bid = face_bids[face].bid;
    select_bid(labels[face], face, bid);
    select_bid(face_bids[face].wanted, face, bid);
}
