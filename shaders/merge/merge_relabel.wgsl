// A merge, second step: all faces follow their clusters. From here on moves count.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> labels: array<u32>;
@group(0) @binding(2) var<storage, read_write> origins: array<u32>;
@group(0) @binding(3) var<storage, read> merged_into: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn merge_relabel(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face >= turn.faces {
        return;
    }
    var label = labels[face];
    if label == FREE {
        return;
    }
    // labels name clusters that were left before this merge, and none of those merges twice
    let into = merged_into[label];
    if into != 0u {
        label = into - 1u;
        labels[face] = label;
    }
    if origins[face] != UNLISTED {
        origins[face] = label;
    }
}
