// Order of equally cheap dual edges (device::dual_edge), bit for bit.

fn mix(number: u32) -> u32 {
    var x = (number ^ (number >> 16u)) * 0x7feb352du;
    x = (x ^ (x >> 15u)) * 0x846ca68bu;
    return x ^ (x >> 16u);
}

// The rank of the edge to `other` as `cluster` sees it: of equally cheap edges, the smallest is the best. By default a
// hash of the unordered pair of numbers.
fn tie_of(cluster: u32, other: u32) -> u32 {
    if iteration.prefers_largest_id != 0u {
        return ~other;
    }
    let low = cluster_numbers[min(cluster, other)];
    let high = cluster_numbers[max(cluster, other)];
    return mix((mix(low) + 0x9e3779b9u) ^ high);
}
