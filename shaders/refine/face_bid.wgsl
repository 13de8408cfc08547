//! uses: boundary_list, accepted_moves, cluster_sums
//! reads: faces, neighbours, labels, proxies
//! writes: clusters, cluster_bids, face_bids, boundary_list
// First step of an iteration of the refinement, a thread a listed face: finds the cluster that the face gains most by
// entering, and bids at that cluster and its own. Rust: device::plain::bids.

fn face_bid(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face == FREE {
        return;
    }
    let before = iteration.number - 1u;
    let own = label_after(face, before);
    if before == 0u {
        // refusals of an earlier phase
        face_bids[face].refused_in = 0u;
    } else if is_refused(face, own, before) {
        face_bids[face].refused_in = before;
    }
    var best = FREE;
    if own != FREE && atomicLoad(&clusters[own].count) > 1u {
        let here = faces[face];
        let refused_in = face_bids[face].refused_in;
        var is_due = refused_in == 0u || cluster_bids[own].changed_in >= refused_in;
        var least = 0x7fffffffffffffffli;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let label = label_after(neighbours[at], before);
            if label != own && label != best && label != FREE {
                is_due |= cluster_bids[label].changed_in >= refused_in;
                let cost = cost_of_entering(here, proxies[label], cluster_weight(label));
                if cost < least || (cost == least && label < best) {
                    best = label;
                    least = cost;
                }
            }
        }
        if best != FREE {
            let gain = gain_of_leaving(here, proxies[own], cluster_weight(own)) - least;
            if is_due && gain > 0li {
                let bid = packed_bid(gain, here);
                face_bids[face].bid = bid;
                atomicMax(&cluster_bids[own].best_bid, bid);
                atomicMax(&cluster_bids[best].best_bid, bid);
            } else {
                best = FREE;
            }
        }
    }
    face_bids[face].wanted_in[iteration.number & 1u] = best;
}
