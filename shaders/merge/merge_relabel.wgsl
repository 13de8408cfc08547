//! uses: iteration
// A merge, second step, a thread a face: faces follow their clusters, and `label_at_merge` of listed faces is set.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> merged_into: array<u32>;
@group(0) @binding(2) var<storage, read_write> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> label_at_merge: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn merge_relabel(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(iteration, group, local);
    if face >= iteration.faces {
        return;
    }
    var label = labels[face];
    if label == FREE {
        return;
    }
    // a label names a cluster that was left before this merge, so one step is enough
    let into = merged_into[label];
    if into != 0u {
        label = into - 1u;
        labels[face] = label;
    }
    if label_at_merge[face] != UNLISTED {
        label_at_merge[face] = label;
    }
}
