// Copies the sums of the clusters that the host listed, a thread each, so that it need not read them all.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> entries: array<u32>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> picked: array<Picked>;

// The sums of a cluster. Rust: layout::Picked.
struct Picked {
    sum: array<u32, 6>,
    weight: array<u32, 2>,
    count: u32,
}

@compute @workgroup_size(WORKGROUP)
fn sums_copy(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let entry = thread_number(turn, group, local);
    if entry >= turn.entries {
        return;
    }
    let cluster = entries[entry];
    for (var word = 0u; word < 6u; word++) {
        picked[entry].sum[word] = atomicLoad(&clusters[cluster].sum[word]);
    }
    for (var word = 0u; word < 2u; word++) {
        picked[entry].weight[word] = atomicLoad(&clusters[cluster].weight[word]);
    }
    picked[entry].count = atomicLoad(&clusters[cluster].count);
}
