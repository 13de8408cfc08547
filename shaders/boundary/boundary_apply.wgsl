//! uses: boundary_insert, cluster_sums, move_count
// Second step of an iteration of the boundary phase, a thread a listed face: the faces move, and their sums with them.
// If all faces want to leave a cluster, the smallest stays.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> wanted_clusters: array<u32>;
@group(0) @binding(4) var<storage, read_write> labels: array<u32>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(7) var<storage, read_write> label_at_merge: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn boundary_apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let face = listed_face(thread);
    if face != FREE {
        let wanted = wanted_clusters[thread];
        if wanted != FREE {
            let own = labels[face];
            // complete since `boundary_propose`
            let is_last = atomicLoad(&clusters[own].staying) == 0u
                && atomicLoad(&clusters[own].first_leaver) == face;
            if !is_last {
                let sums = sums_of(faces[face]);
                add_to_cluster(own, sums_minus(NO_SUMS, sums), -1i);
                add_to_cluster(wanted, sums, 1i);
                atomicStore(&clusters[own].connected, 0u);
                labels[face] = wanted;
                atomicAdd(&moves_here, 1u);
                // neighbours inside `own` are on the boundary now
                let end = neighbours[face + 1u];
                for (var at = neighbours[face]; at < end; at++) {
                    if claim(neighbours[at], own) {
                        insert(neighbours[at]);
                    }
                }
            }
        }
    }
    write_inserted(local);
    add_moves(local);
}
