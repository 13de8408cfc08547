//! uses: iteration, cluster
// Copies the sums of the clusters of `host_list`, a thread each, for the host.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> host_list: array<u32>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> copied_sums: array<CopiedSums>;

// Rust: layout::CopiedSums.
struct CopiedSums {
    moment: array<u32, 6>,
    weight: array<u32, 2>,
    count: u32,
}

@compute @workgroup_size(WORKGROUP)
fn sums_copy(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let entry = thread_number(iteration, group, local);
    if entry >= iteration.entries {
        return;
    }
    let cluster = host_list[entry];
    for (var word = 0u; word < 6u; word++) {
        copied_sums[entry].moment[word] = atomicLoad(&clusters[cluster].moment[word]);
    }
    for (var word = 0u; word < 2u; word++) {
        copied_sums[entry].weight[word] = atomicLoad(&clusters[cluster].weight[word]);
    }
    copied_sums[entry].count = atomicLoad(&clusters[cluster].count);
}
