// One pass of the growth (P§5.3): every free face with labelled neighbours takes the smallest of their labels. Reads one
// array of labels and writes the other, so all faces see the state before the pass.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbour_offsets: array<u32>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels_before: array<u32>;
@group(0) @binding(4) var<storage, read_write> labels_after: array<u32>;
@group(0) @binding(5) var<storage, read_write> ring: array<Slot>;

var<workgroup> adopted: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn grow(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face < turn.faces {
        var label = labels_before[face];
        if label == FREE {
            let end = neighbour_offsets[face + 1u];
            for (var at = neighbour_offsets[face]; at < end; at++) {
                label = min(label, labels_before[neighbours[at]]);
            }
            if label != FREE {
                atomicAdd(&adopted, 1u);
            }
        }
        labels_after[face] = label;
    }
    workgroupBarrier();
    if local == 0u {
        let here = atomicLoad(&adopted);
        if here != 0u {
            atomicAdd(&ring[turn.slot].moves, here);
        }
    }
}
