//! reads: host_list
//! writes: clusters, copied_sums
// Copies the sums of the clusters of `host_list`, a thread each, for the host. Rust: device::sums_of.

fn sums_copy(entry: u32, local: u32) {
    if entry >= iteration.entries {
        return;
    }
    let cluster = host_list[entry];
    // the ends of the cheapest dual edge where there is none
    if cluster == FREE {
        return;
    }
    for (var word = 0u; word < SUM_WORDS; word++) {
        copied_sums[entry].sums[word] = atomicLoad(&clusters[cluster].sums[word]);
    }
    copied_sums[entry].count = atomicLoad(&clusters[cluster].count);
}
