//! uses: living_clusters, cluster_sums, energy_total, cover
//! reads: living_clusters
//! writes: clusters, proxies, cluster_bids, stats, next_dispatch, boundary_list
// Last step of an iteration of the boundary phase (P§3.2), a thread a cluster: fits the proxies, sums the energy, and
// stops the dispatches that are still queued if nothing moved. Between batches it also resets the clusters for the next
// phase. Rust: device::plain::explained.

fn proxies_fit(thread: u32, local: u32) {
    let cluster = living_cluster(thread);
    // the moves are complete since `boundary_apply`
    let is_going_on = iteration.between != 0u || atomicLoad(&stats[iteration.slot].moves) != 0u;
    if thread == 0u {
        cover(is_going_on);
    }
    var energy = ZERO;
    var shift = 0u;
    if is_going_on && cluster != FREE {
        let count = atomicLoad(&clusters[cluster].count);
        if count != 0u {
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
