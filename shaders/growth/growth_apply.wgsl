//! uses: boundary_list
// Second step of a pass of the growth, a thread a listed face: the labels follow.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> wanted_clusters: array<u32>;
@group(0) @binding(2) var<storage, read_write> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn growth_apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let face = listed_face(thread);
    if face != FREE && wanted_clusters[thread] != FREE {
        labels[face] = wanted_clusters[thread];
    }
}
