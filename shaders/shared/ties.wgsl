// Order of equally cheap dual edges (cluster::dual_edge), bit for bit.

const TIES_BY_HASH: u32 = 0u;
const TIES_BY_LARGEST_ID: u32 = 1u;

fn mix(number: u32) -> u32 {
    var x = (number ^ (number >> 16u)) * 0x7feb352du;
    x = (x ^ (x >> 15u)) * 0x846ca68bu;
    return x ^ (x >> 16u);
}

// A hash of an unordered pair.
fn hash_pair(a: u32, b: u32) -> u32 {
    return mix((mix(min(a, b)) + 0x9e3779b9u) ^ max(a, b));
}

// The rank of the edge to `other` as `cluster` sees it: of equally cheap edges, the smallest is the best.
fn tie_of(cluster: u32, other: u32) -> u32 {
    if iteration.ties == TIES_BY_LARGEST_ID {
        return ~other;
    }
    return hash_pair(cluster, other);
}
