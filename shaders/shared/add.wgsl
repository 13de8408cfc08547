// Adding to the 64-bit sums of `clusters` without 64-bit atomics. The addition to the low word returns what was there, which
// tells whether this addition carried, whoever else adds at the same time; so when the dispatch has ended the two words hold
// the sum modulo 2⁶⁴, in whatever order the additions came.

fn add_to_sum(cluster: u32, axis: u32, value: i64) {
    let bits = u64(value);
    let low = u32(bits & 0xfffffffflu);
    let before = atomicAdd(&clusters[cluster].sum[2u * axis], low);
    let high = u32(bits >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&clusters[cluster].sum[2u * axis + 1u], high);
    }
}

fn add_to_weight(cluster: u32, value: i64) {
    let bits = u64(value);
    let low = u32(bits & 0xfffffffflu);
    let before = atomicAdd(&clusters[cluster].weight[0], low);
    let high = u32(bits >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&clusters[cluster].weight[1], high);
    }
}

// Adds Σ weight·centroid, Σ weight and the number of some faces; negative to take faces away.
fn add_to_cluster(cluster: u32, sum: vec3<i64>, weight: i64, count: i32) {
    add_to_sum(cluster, 0u, sum.x);
    add_to_sum(cluster, 1u, sum.y);
    add_to_sum(cluster, 2u, sum.z);
    add_to_weight(cluster, weight);
    atomicAdd(&clusters[cluster].count, u32(count));
}
