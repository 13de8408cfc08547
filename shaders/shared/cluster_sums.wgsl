//! uses: cluster, energy
// Reads and adds to the sums of `clusters`. Without 64-bit atomics, an addition takes two of 32 bits: the addition to
// the low word returns the value before, which shows whether this addition carried, in whatever order threads add. So
// at the end of the dispatch the two words hold the sum modulo 2⁶⁴. A kernel does not read sums that it adds to.

fn cluster_weight(cluster: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].weight[0]));
    let high = u64(atomicLoad(&clusters[cluster].weight[1]));
    return i64((high << 32u) | low);
}

fn cluster_moment(cluster: u32, axis: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].moment[2u * axis]));
    let high = u64(atomicLoad(&clusters[cluster].moment[2u * axis + 1u]));
    return i64((high << 32u) | low);
}

fn cluster_sums(cluster: u32) -> Sums {
    let moment = vec3<i64>(cluster_moment(cluster, 0u), cluster_moment(cluster, 1u), cluster_moment(cluster, 2u));
    return Sums(moment, cluster_weight(cluster));
}

fn add_moment(cluster: u32, axis: u32, value: i64) {
    let low = u32(u64(value) & 0xfffffffflu);
    let before = atomicAdd(&clusters[cluster].moment[2u * axis], low);
    let high = u32(u64(value) >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&clusters[cluster].moment[2u * axis + 1u], high);
    }
}

// Adds the sums of `count` faces; negative to take faces away.
fn add_to_cluster(cluster: u32, sums: Sums, count: i32) {
    add_moment(cluster, 0u, sums.moment.x);
    add_moment(cluster, 1u, sums.moment.y);
    add_moment(cluster, 2u, sums.moment.z);
    let low = u32(u64(sums.weight) & 0xfffffffflu);
    let before = atomicAdd(&clusters[cluster].weight[0], low);
    let high = u32(u64(sums.weight) >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&clusters[cluster].weight[1], high);
    }
    atomicAdd(&clusters[cluster].count, u32(count));
}
