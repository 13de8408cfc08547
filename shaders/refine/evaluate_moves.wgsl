//! uses: boundary_list, bids, cluster_sums, energy_total, count, lengths
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
    let sums = Sums(@list(take_sum(cluster, #u)));
    return Change(sums, atomicExchange(&cluster_bids[cluster].joining, 0u));
}

// Replaces the sums of a cluster, and its proxy.
fn store_cluster(cluster: u32, sums: Sums, count: u32, proxy: Proxy) {
    store_sums(cluster, sums, count);
    proxies[cluster] = proxy;
    atomicStore(&clusters[cluster].active_in, 2u * iteration.number + 1u);
}

// Decides about the move out of a cluster. Returns the rise of the explained energy.
fn evaluate(own: u32) -> Wide {
    let into = cluster_bids[own].target_cluster;
    // both clusters lie in one component, so the shift is the same
    let shift = proxies[own].energy_shift;
    let sums = cluster_sums(own);
    let into_sums = cluster_sums(into);
    let count = atomicLoad(&clusters[own].count);
    let before = plus(explained(fit(sums, shift), sums), explained(fit(into_sums, shift), into_sums));
    var change = take_joining(own);
    var accepted = ALL_MOVE;
    loop {
        // a cluster keeps a face
        if count > change.count {
            let rest = sums_minus(sums, change.sums);
            let joined = sums_plus(into_sums, change.sums);
            let proxy = fit(rest, shift);
            let into_proxy = fit(joined, shift);
            let rise = minus(plus(explained(proxy, rest), explained(into_proxy, joined)), before);
            if is_positive(rise) {
                store_cluster(own, rest, count - change.count, proxy);
                store_cluster(into, joined, atomicLoad(&clusters[into].count) + change.count, into_proxy);
                atomicStore(&clusters[own].connected, 0u);
                atomicAdd(&counted, change.count);
                cluster_bids[own].accepted = accepted;
                return rise;
            }
        }
        // a winner that nothing joined was tried already
        if accepted == WINNER_MOVES || change.count == 1u {
            break;
        }
        change = Change(sums_of(faces[cluster_bids[own].winner]), 1u);
        accepted = WINNER_MOVES;
    }
    cluster_bids[own].accepted = REFUSED;
    return Wide(0li, 0li);
}

fn evaluate_moves(face: u32) {
    let own = labels[face];
    if cluster_bids[own].won_in == iteration.number && cluster_bids[own].winner == face {
        add_energy(evaluate(own), proxies[own].energy_shift);
    }
}

fn evaluate_moves_end(local: u32, group: u32) {
    write_energy(local);
    add_moves(local);
    if local == 0u && group == 0u {
        let bids = movers();
        write_lengths(bids);
        boundary_list.ended = select(iteration.batch, 0u, bids != 0u);
        // of the next iteration
        atomicStore(&boundary_list.lengths[2u + ((iteration.number + 1u) & 1u)], 0u);
    }
}
