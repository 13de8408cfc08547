//! uses: iteration, cluster_sums
// A merge, first step, a thread a pair of `host_list`: the sums of the first cluster are added to the second. No
// cluster is in two pairs.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> host_list: array<u32>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> merged_into: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn merge_apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let pair = thread_number(iteration, group, local);
    if pair >= iteration.entries {
        return;
    }
    let ending = host_list[2u * pair];
    let into = host_list[2u * pair + 1u];
    add_to_cluster(into, cluster_sums(ending), i32(atomicLoad(&clusters[ending].count)));
    atomicMin(&clusters[into].connected, atomicLoad(&clusters[ending].connected));
    for (var word = 0u; word < 6u; word++) {
        atomicStore(&clusters[ending].moment[word], 0u);
    }
    atomicStore(&clusters[ending].weight[0], 0u);
    atomicStore(&clusters[ending].weight[1], 0u);
    atomicStore(&clusters[ending].count, 0u);
    merged_into[ending] = into + 1u;
}
