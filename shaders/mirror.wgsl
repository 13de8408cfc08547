// Before a growth in a hierarchy: its second array of labels gets those of the listed faces and of the ones beside them, which
// are all that it looks at.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> copies: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn mirror(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face == FREE {
        return;
    }
    atomicStore(&copies[face], labels[face]);
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        atomicStore(&copies[neighbours[at]], labels[neighbours[at]]);
    }
}
