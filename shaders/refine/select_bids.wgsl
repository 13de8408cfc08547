//! uses: boundary_list, accepted_moves, count
//! reads: face_bids
//! writes: labels, cluster_bids, stats, boundary_list
// Second step, a thread a listed face: the label follows the moves of the iteration before, and each cluster takes the
// smallest face of those with its best bid. Rust: device::plain::winners.

fn select_bids(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face != FREE {
        let own = label_after(face, iteration.number - 1u);
        labels[face] = own;
        let wanted = face_bids[face].wanted_in[iteration.number & 1u];
        if wanted != FREE {
            let bid = face_bids[face].bid;
            if atomicLoad(&cluster_bids[own].best_bid) == bid {
                atomicMin(&cluster_bids[own].best_face, face);
            }
            if atomicLoad(&cluster_bids[wanted].best_bid) == bid {
                atomicMin(&cluster_bids[wanted].best_face, face);
            }
            atomicAdd(&counted, 1u);
        }
    }
    let bids = counted_here(local);
    if bids != 0u {
        atomicAdd(&stats[iteration.slot].bids, bids);
    }
}
