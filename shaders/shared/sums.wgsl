// The 64-bit sums of `clusters`, read in a dispatch in which nobody else adds to them.

fn sum_on(cluster: u32, axis: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].sum[2u * axis]));
    let high = u64(atomicLoad(&clusters[cluster].sum[2u * axis + 1u]));
    return i64((high << 32u) | low);
}

fn sum_of(cluster: u32) -> vec3<i64> {
    return vec3<i64>(sum_on(cluster, 0u), sum_on(cluster, 1u), sum_on(cluster, 2u));
}

fn weight_in(cluster: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].weight[0]));
    let high = u64(atomicLoad(&clusters[cluster].weight[1]));
    return i64((high << 32u) | low);
}
