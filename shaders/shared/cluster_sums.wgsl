//! uses: energy
// Reads and adds to the sums of `clusters`. Without 64-bit atomics, an addition takes two of 32 bits: the addition to
// the low word returns the value before, which shows whether this addition carried, in whatever order threads add. So
// at the end of the dispatch the two words hold the sum modulo 2⁶⁴. A kernel does not read sums that it adds to.
//
// The numbers of sums are written out here and in kernels: an index that is computed would put 64-bit arrays into
// memory of the thread, which drivers seldom compile.

fn cluster_sum(cluster: u32, at: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].sums[2u * at]));
    let high = u64(atomicLoad(&clusters[cluster].sums[2u * at + 1u]));
    return i64((high << 32u) | low);
}

fn cluster_weight(cluster: u32) -> i64 {
    return cluster_sum(cluster, WEIGHT);
}

fn cluster_sums(cluster: u32) -> Sums {
    return Sums(@list(cluster_sum(cluster, #u)));
}

fn add_to_sum(cluster: u32, at: u32, value: i64) {
    let low = u32(u64(value) & 0xfffffffflu);
    let before = atomicAdd(&clusters[cluster].sums[2u * at], low);
    let high = u32(u64(value) >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&clusters[cluster].sums[2u * at + 1u], high);
    }
}

// Adds the sums of `count` faces; negative to take faces away.
fn add_to_cluster(cluster: u32, sums: Sums, count: i32) {
    @each(add_to_sum(cluster, #u, sums[#]);)
    atomicAdd(&clusters[cluster].count, u32(count));
}

fn store_sum(cluster: u32, at: u32, value: i64) {
    atomicStore(&clusters[cluster].sums[2u * at], u32(u64(value) & 0xfffffffflu));
    atomicStore(&clusters[cluster].sums[2u * at + 1u], u32(u64(value) >> 32u));
}

// Replaces the sums of a cluster that no other thread reads or adds to.
fn store_sums(cluster: u32, sums: Sums, count: u32) {
    @each(store_sum(cluster, #u, sums[#]);)
    atomicStore(&clusters[cluster].count, count);
}
