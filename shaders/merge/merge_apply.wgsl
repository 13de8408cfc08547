// A merge, first step, a thread a pair: the sums of the first cluster go to the second. No cluster is in two pairs.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> entries: array<u32>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> merged_into: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn merge_apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let pair = thread_number(turn, group, local);
    if pair >= turn.entries {
        return;
    }
    let ending = entries[2u * pair];
    let into = entries[2u * pair + 1u];
    add_to_cluster(into, sum_of(ending), weight_in(ending), i32(atomicLoad(&clusters[ending].count)));
    // pieces that nobody has looked for yet go with it
    atomicMin(&clusters[into].whole, atomicLoad(&clusters[ending].whole));
    for (var word = 0u; word < 6u; word++) {
        atomicStore(&clusters[ending].sum[word], 0u);
    }
    atomicStore(&clusters[ending].weight[0], 0u);
    atomicStore(&clusters[ending].weight[1], 0u);
    atomicStore(&clusters[ending].count, 0u);
    merged_into[ending] = into + 1u;
}
