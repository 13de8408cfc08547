//! uses: boundary_list, bids, cluster_sums, energy_total, count
//! reads: faces, labels
//! writes: clusters, proxies, cluster_bids, stats, boundary_list
// Fourth step, a thread a mover: a winner compares the energy of its two clusters before and after, exactly, with all
// joining faces and then alone, and updates sums and proxies. A cluster is in one move at most, so no other thread
// touches the two. The phase ends if there were no bids. Rust: device::plain::try_moving.

// Faces that move together.
struct Change {
    sums: Sums,
    count: u32,
}

fn take_sum(cluster: u32, at: u32) -> i64 {
    let low = u64(atomicExchange(&cluster_bids[cluster].joining_sums[2u * at], 0u));
    let high = u64(atomicExchange(&cluster_bids[cluster].joining_sums[2u * at + 1u], 0u));
    return i64((high << 32u) | low);
}

// Reads the sums of the joining faces and clears them for the next iteration.
fn take_joining(cluster: u32) -> Change {
    let sums = Sums(take_sum(cluster, 0u), take_sum(cluster, 1u), take_sum(cluster, 2u), take_sum(cluster, 3u));
    return Change(sums, atomicExchange(&cluster_bids[cluster].joining, 0u));
}

// The explained energy of a cluster with its own proxy.
fn explained_by_own(sums: Sums) -> Wide {
    return explained(fit(sums, 0u), sums);
}

// The rise of the explained energy; none if no face would be left.
fn rise(own: Sums, into: Sums, count: u32, change: Change) -> Wide {
    if count <= change.count {
        return ZERO;
    }
    let before = plus(explained_by_own(own), explained_by_own(into));
    let rest = explained_by_own(sums_minus(own, change.sums));
    return minus(plus(rest, explained_by_own(sums_plus(into, change.sums))), before);
}

// Replaces the sums of a cluster, and its proxy.
fn store_cluster(cluster: u32, sums: Sums, count: u32) {
    store_sums(cluster, sums, count);
    proxies[cluster] = fit(sums, proxies[cluster].energy_shift);
    cluster_bids[cluster].changed_in = iteration.number;
}

// Decides about the move out of a cluster. Returns the rise of the explained energy.
fn evaluate(own: u32) -> Wide {
    let into = cluster_bids[own].target_cluster;
    let sums = cluster_sums(own);
    let into_sums = cluster_sums(into);
    let count = atomicLoad(&clusters[own].count);
    var change = take_joining(own);
    var accepted = ALL_MOVE;
    var energy = rise(sums, into_sums, count, change);
    // a winner that nothing joined was tried already
    if !is_positive(energy) && change.count > 1u {
        change = Change(sums_of(faces[cluster_bids[own].winner]), 1u);
        accepted = WINNER_MOVES;
        energy = rise(sums, into_sums, count, change);
    }
    if is_positive(energy) {
        store_cluster(own, sums_minus(sums, change.sums), count - change.count);
        store_cluster(into, sums_plus(into_sums, change.sums), atomicLoad(&clusters[into].count) + change.count);
        atomicStore(&clusters[own].connected, 0u);
        atomicAdd(&counted, change.count);
    } else {
        accepted = REFUSED;
        energy = ZERO;
    }
    cluster_bids[own].accepted = accepted;
    return energy;
}

fn evaluate_moves(face: u32) {
    let own = labels[face];
    if cluster_bids[own].won_in == iteration.number && cluster_bids[own].winner == face {
        // both clusters lie in one component, so the shift is the same
        add_energy(evaluate(own), proxies[own].energy_shift);
    }
}

fn evaluate_moves_end(local: u32, group: u32) {
    write_energy(local);
    add_moves(local);
    if local == 0u && group == 0u {
        let bids = movers();
        atomicStore(&stats[iteration.slot].movers, bids);
        boundary_list.ended = select(iteration.batch, 0u, bids != 0u);
        // of the next iteration
        atomicStore(&boundary_list.lengths[2u + ((iteration.number + 1u) & 1u)], 0u);
    }
}
