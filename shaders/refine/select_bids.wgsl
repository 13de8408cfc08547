//! uses: boundary_list, count
//! reads: labels, face_bids
//! writes: cluster_bids, stats, boundary_list
// Second step, a thread a listed face: each cluster takes the smallest face of those with its best bid. Rust:
// device::plain::winners.

fn select_bids(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face != FREE && face_bids[face].cluster != FREE {
        let bid = face_bids[face];
        let own = labels[face];
        if atomicLoad(&cluster_bids[own].best_bid) == bid.bid {
            atomicMin(&cluster_bids[own].best_face, face);
        }
        if atomicLoad(&cluster_bids[bid.cluster].best_bid) == bid.bid {
            atomicMin(&cluster_bids[bid.cluster].best_face, face);
        }
        atomicAdd(&counted, 1u);
    }
    let bids = counted_here(local);
    if bids != 0u {
        atomicAdd(&stats[iteration.slot].bids, bids);
    }
}
