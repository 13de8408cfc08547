//! uses: boundary_list, cluster_sums, move_count
// First step of a pass of the growth (P§5.3), a thread a listed face: a free face with labelled neighbours chooses the
// smallest of their labels. Every free face is listed.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
@group(0) @binding(4) var<storage, read_write> wanted_clusters: array<u32>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(7) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn growth_propose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let face = listed_face(thread);
    if face != FREE {
        var label = FREE;
        if labels[face] == FREE {
            let end = neighbours[face + 1u];
            for (var at = neighbours[face]; at < end; at++) {
                label = min(label, labels[neighbours[at]]);
            }
            if label != FREE {
                atomicAdd(&moves_here, 1u);
                add_to_cluster(label, sums_of(faces[face]), 1i);
            }
        }
        wanted_clusters[thread] = label;
    }
    add_moves(local);
}
