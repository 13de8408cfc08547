// A merge, second step: the faces follow their clusters.

@group(0) @binding(0) var<uniform> turn: Turn;
// 0 for a cluster that goes on, else one more than the one it became part of.
@group(0) @binding(1) var<storage, read> merged_into: array<u32>;
@group(0) @binding(2) var<storage, read_write> labels: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn relabel(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face < turn.faces && labels[face] != FREE {
        let into = merged_into[labels[face]];
        if into != 0u {
            labels[face] = into - 1u;
        }
    }
}
