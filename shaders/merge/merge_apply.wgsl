//! uses: cluster_sums
//! reads: host_list
//! writes: clusters, proxies, merged_into
// A merge (P§5.4), first step, a thread a pair of `host_list`: the sums of the first cluster are added to the second,
// whose proxy is fitted. No cluster is in two pairs. Rust: device::merge.

fn merge_apply(pair: u32) {
    let ending = host_list[2u * pair];
    let into = host_list[2u * pair + 1u];
    let sums = sums_plus(cluster_sums(into), cluster_sums(ending));
    let count = atomicLoad(&clusters[into].count) + atomicLoad(&clusters[ending].count);
    store_sums(into, sums, count);
    store_sums(ending, NO_SUMS, 0u);
    atomicStore(&clusters[into].staying, count);
    atomicMin(&clusters[into].connected, atomicLoad(&clusters[ending].connected));
    if count != 0u {
        proxies[into] = fit(sums, proxies[into].energy_shift);
    }
    merged_into[ending] = into + 1u;
}
