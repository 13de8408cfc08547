//! uses: iteration, cluster_sums
// Sums of the clusters from labels; the host has cleared the sums. A thread takes a few faces in a row and adds up
// those with the same label before it touches global memory: neighbouring faces often have the same.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> clusters: array<Cluster>;

// Faces a thread takes.
const RUN: u32 = 8u;

@compute @workgroup_size(WORKGROUP)
fn sums_gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = thread_number(iteration, group, local) * RUN;
    let end = min(first + RUN, iteration.faces);
    var label = FREE;
    var sums = NO_SUMS;
    var count = 0i;
    for (var face = first; face < end; face++) {
        let next = labels[face];
        if next != label {
            if label != FREE {
                add_to_cluster(label, sums, count);
            }
            label = next;
            sums = NO_SUMS;
            count = 0i;
        }
        sums = sums_plus(sums, sums_of(faces[face]));
        count += 1i;
    }
    if label != FREE {
        add_to_cluster(label, sums, count);
    }
}
