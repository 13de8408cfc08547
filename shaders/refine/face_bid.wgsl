//! uses: due_faces, cluster_sums
//! reads: faces, neighbours, labels, proxies
//! writes: clusters, cluster_bids, face_bids, boundary_list
// First step of an iteration of the refinement, a thread a listed face: finds the cluster that a due face gains most by
// entering, and bids at that cluster and its own; such a face becomes a mover. The bid of another face stands until it
// moves or is refused. Rust: device::plain::bids.

fn place_bid(face: u32, own: u32, wanted: u32, bid: u32) {
    atomicMax(&cluster_bids[own].best_bid, bid);
    atomicMax(&cluster_bids[wanted].best_bid, bid);
    append_mover(face);
}

fn evaluate(face: u32, own: u32, visitor: u32) {
    let here = faces[face];
    var best = FREE;
    var least = 0x7fffffffffffffffli;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let label = labels[neighbours[at]];
        if label == own || label == FREE {
            continue;
        }
        if !is_own_task(at, label, visitor) {
            return;
        }
        if label != best {
            let cost = cost_of_entering(here, proxies[label], cluster_weight(label));
            if cost < least || (cost == least && label < best) {
                best = label;
                least = cost;
            }
        }
    }
    atomicAdd(&due_count, 1u);
    var bid = 0u;
    if best != FREE && atomicLoad(&clusters[own].count) > 1u {
        let gain = gain_of_leaving(here, proxies[own], cluster_weight(own)) - least;
        if gain > 0li {
            bid = packed_bid(gain, here);
            face_bids[face].wanted = best;
            place_bid(face, own, best, bid);
        }
    }
    face_bids[face].bid = bid;
}

// Repeats the bid of a face whose cluster has not changed, unless it is due: another thread evaluates it then.
fn repeat_bid(face: u32, own: u32) {
    let bid = face_bids[face].bid;
    if bid == 0u {
        return;
    }
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let label = labels[neighbours[at]];
        if label != own && label != FREE && has_changed(label) {
            return;
        }
    }
    place_bid(face, own, face_bids[face].wanted, bid);
}

fn face_bid(face: u32) {
    let own = labels[face];
    if own == FREE {
        return;
    }
    if has_changed(own) {
        evaluate_due(face, own);
    } else if atomicLoad(&clusters[own].active_in) == 2u * (iteration.number - 1u) {
        repeat_bid(face, own);
    }
}

fn face_bid_end(local: u32, group: u32) {
    write_due(local);
}
