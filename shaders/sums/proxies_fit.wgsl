//! uses: iteration, cluster_sums, bids, energy_total, cover
// Last step of an iteration of the boundary phase, a thread a cluster: fits the proxies, sums the energy, and stops the
// dispatches that are still queued if nothing moved. Between batches it also resets the clusters for the next phase.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(2) var<storage, read_write> proxies: array<Proxy>;
@group(0) @binding(3) var<storage, read_write> cluster_bids: array<ClusterBids>;
@group(0) @binding(4) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(5) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(6) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn proxies_fit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let cluster = living_cluster(thread);
    // the moves are complete since `boundary_apply`
    let goes_on = iteration.between != 0u || atomicLoad(&stats[iteration.slot].moves) != 0u;
    if thread == 0u {
        if goes_on {
            cover_list();
        } else {
            cover_nothing();
        }
    }
    var energy = Wide(0li, 0li);
    var shift = 0u;
    if goes_on && cluster != FREE {
        let sums = cluster_sums(cluster);
        if sums.weight != 0li {
            let position = fit(sums);
            energy = explained_by(position, sums);
            shift = proxies[cluster].energy_shift;
            proxies[cluster] = fitted_proxy(position, shift);
        }
        atomicStore(&clusters[cluster].staying, atomicLoad(&clusters[cluster].count));
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
