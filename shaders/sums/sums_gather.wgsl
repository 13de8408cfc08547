// Sums of the clusters from labels; the sums were cleared before. A thread takes a few faces in a row and adds up those with
// the same label before it touches memory that others share: the order of faces is local, so they often have the same.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> clusters: array<Cluster>;

// Faces a thread takes.
const RUN: u32 = 8u;

@compute @workgroup_size(WORKGROUP)
fn sums_gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = thread_number(turn, group, local) * RUN;
    let end = min(first + RUN, turn.faces);
    var label = FREE;
    var sum = vec3<i64>(0li, 0li, 0li);
    var weight = 0li;
    var count = 0i;
    for (var face = first; face < end; face++) {
        let next = labels[face];
        if next != label {
            if label != FREE {
                add_to_cluster(label, sum, weight, count);
            }
            label = next;
            sum = vec3<i64>(0li, 0li, 0li);
            weight = 0li;
            count = 0i;
        }
        sum += moment_of(faces[face]);
        weight += weight_of(faces[face]);
        count += 1i;
    }
    if label != FREE {
        add_to_cluster(label, sum, weight, count);
    }
}
