// One pass of the growth (P§5.3): every free face, all of which are listed, takes the smallest label of its neighbours, if one
// has a label. Reads one array of labels and writes the other, so all faces see the state before the pass.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels_before: array<u32>;
@group(0) @binding(3) var<storage, read_write> labels_after: array<u32>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(5) var<storage, read_write> lists: Lists;
@group(0) @binding(6) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(7) var<storage, read_write> clusters: array<Cluster>;

var<workgroup> adopted: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn growth_propose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face != FREE {
        var label = labels_before[face];
        if label == FREE {
            let end = neighbours[face + 1u];
            for (var at = neighbours[face]; at < end; at++) {
                label = min(label, labels_before[neighbours[at]]);
            }
            if label != FREE {
                atomicAdd(&adopted, 1u);
                add_to_cluster(label, moment_of(faces[face]), weight_of(faces[face]), 1i);
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
