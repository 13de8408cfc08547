//! uses: boundary_list, cluster_sums, energy_total, cover
//! writes: clusters, proxies, cluster_bids, stats, next_dispatch, boundary_list
// Last step of a pass of the boundary phase (P§3.2), a thread a cluster: fits the proxies, sums the energy, and stops
// the dispatches that are still queued if nothing moved. A flood holds the proxies while faces move; the pass in which
// none does ends the iteration. Between batches it also resets the clusters for the next phase.
// Rust: device::plain::explained.

fn proxies_fit(thread: u32, local: u32) {
    let cluster = living_cluster(thread);
    // the moves are complete since `boundary_apply`
    let has_moved = atomicLoad(&stats[iteration.slot].moves) != 0u;
    let is_pass = iteration.between == 0u;
    let is_flooding = is_pass && has_moved && iteration.number >= FLOOD_FROM;
    // the pass before was part of a flood in which faces moved
    let ends_flood = is_pass && iteration.number > FLOOD_FROM
        && atomicLoad(&boundary_list.moved_in) == iteration.number - 1u;
    let is_going_on = !is_pass || has_moved || ends_flood;
    if thread == 0u {
        cover(is_going_on);
    }
    var energy = ZERO;
    var shift = 0u;
    if is_going_on && cluster != FREE {
        let count = atomicLoad(&clusters[cluster].count);
        if count != 0u && !is_flooding {
            let sums = cluster_sums(cluster);
            shift = proxies[cluster].energy_shift;
            let proxy = fit(sums, shift);
            energy = explained(proxy, sums);
            proxies[cluster] = proxy;
        }
        atomicStore(&clusters[cluster].staying, count);
        atomicStore(&clusters[cluster].first_leaver, FREE);
        if iteration.between != 0u {
            atomicStore(&cluster_bids[cluster].best_bid, 0u);
            atomicStore(&cluster_bids[cluster].best_face, FREE);
            cluster_bids[cluster].won_in = 0u;
            cluster_bids[cluster].changed_in = 0u;
        }
    }
    add_energy(local, energy, shift);
}
