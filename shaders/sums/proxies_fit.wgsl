//! uses: boundary_list, cluster_sums, energy_total, lengths
//! reads: living_clusters
//! writes: clusters, proxies, cluster_bids, stats, boundary_list
// Last step of a pass of the boundary phase (P§3.2), a thread a cluster: fits the proxies, sums the energy, makes the
// clusters ready for the next step, and ends the phase if nothing moved. A flood holds the proxies while faces move;
// the pass in which none does ends the iteration. Rust: device::plain::explained.

fn proxies_fit(at: u32) {
    let cluster = living_clusters[at];
    // the moves are complete since `boundary_apply`
    let has_moved = atomicLoad(&stats[iteration.slot].moves) != 0u;
    let is_pass = iteration.between == 0u;
    let is_flooding = is_pass && has_moved && iteration.in_phase >= FLOOD_FROM;
    // the pass before was part of a flood in which faces moved; faces are due then where a proxy changes now
    let ends_flood = is_pass && iteration.in_phase > FLOOD_FROM
        && atomicLoad(&boundary_list.moved_in) == iteration.number - 1u;
    let is_going_on = !is_pass || has_moved || ends_flood;
    if at == 0u {
        if is_pass {
            write_lengths(movers());
            boundary_list.ended = select(iteration.batch, 0u, is_going_on);
        }
        for (var list = 2u; list < 5u; list++) {
            atomicStore(&boundary_list.lengths[list], 0u);
        }
    }
    if !is_going_on {
        return;
    }
    let count = atomicLoad(&clusters[cluster].count);
    if count != 0u && !is_flooding {
        let sums = cluster_sums(cluster);
        let shift = proxies[cluster].energy_shift;
        let proxy = fit(sums, shift);
        add_energy(explained(proxy, sums), shift);
        if ends_flood && !is_same(proxy, proxies[cluster]) {
            atomicStore(&clusters[cluster].active_in, 2u * iteration.number + 1u);
        }
        proxies[cluster] = proxy;
    }
    atomicStore(&clusters[cluster].staying, count);
    atomicStore(&clusters[cluster].first_leaver, FREE);
    atomicStore(&cluster_bids[cluster].best_bid, 0u);
    atomicStore(&cluster_bids[cluster].best_face, FREE);
}

fn proxies_fit_end(local: u32, group: u32) {
    write_energy(local);
}
