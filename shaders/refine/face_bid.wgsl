//! uses: append, cluster_sums
//! reads: faces, neighbours, labels, proxies
//! writes: clusters, cluster_bids, face_bids, boundary_list
// First step of an iteration of the refinement, a thread a listed face: finds the cluster that the face gains most by
// entering, and bids at that cluster and its own; such a face becomes a mover. Rust: device::plain::bids.

fn face_bid(face: u32) {
    if iteration.number == 1u {
        // refusals of an earlier phase
        face_bids[face].refused_in = 0u;
    }
    let own = labels[face];
    if own == FREE || atomicLoad(&clusters[own].count) <= 1u {
        return;
    }
    let here = faces[face];
    let refused_in = face_bids[face].refused_in;
    var is_due = refused_in == 0u || cluster_bids[own].changed_in >= refused_in;
    var best = FREE;
    var least = 0x7fffffffffffffffli;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let label = labels[neighbours[at]];
        if label != own && label != best && label != FREE {
            is_due |= cluster_bids[label].changed_in >= refused_in;
            let cost = cost_of_entering(here, proxies[label], cluster_weight(label));
            if cost < least || (cost == least && label < best) {
                best = label;
                least = cost;
            }
        }
    }
    if best == FREE || !is_due {
        return;
    }
    let gain = gain_of_leaving(here, proxies[own], cluster_weight(own)) - least;
    if gain > 0li {
        let bid = packed_bid(gain, here);
        face_bids[face].wanted = best;
        face_bids[face].bid = bid;
        atomicMax(&cluster_bids[own].best_bid, bid);
        atomicMax(&cluster_bids[best].best_bid, bid);
        append_mover(face);
    }
}

fn face_bid_end(local: u32, group: u32) {
    write_movers(local);
}
