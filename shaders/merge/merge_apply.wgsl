//! uses: cluster_sums
//! reads: host_list
//! writes: clusters, merged_into
// A merge (P§5.4), first step, a thread a pair of `host_list`: the sums of the first cluster are added to the second.
// No cluster is in two pairs. Rust: device::merge.

fn merge_apply(pair: u32, local: u32) {
    if pair >= iteration.entries {
        return;
    }
    let ending = host_list[2u * pair];
    let into = host_list[2u * pair + 1u];
    add_to_cluster(into, cluster_sums(ending), i32(atomicLoad(&clusters[ending].count)));
    atomicMin(&clusters[into].connected, atomicLoad(&clusters[ending].connected));
    store_sums(ending, NO_SUMS, 0u);
    merged_into[ending] = into + 1u;
}
