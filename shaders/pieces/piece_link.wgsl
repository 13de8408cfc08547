//! uses: iteration, cluster
// Connected pieces of clusters, first step, a thread a face (ECL-CC, Jaiganesh and Burtscher 2018): a face of a cluster
// that is not known to be connected points to the smallest of itself and its neighbours in the cluster.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(4) var<storage, read_write> parents: array<u32>;
@group(0) @binding(5) var<storage, read_write> piece_sizes: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn piece_link(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(iteration, group, local);
    if face >= iteration.faces {
        return;
    }
    let own = labels[face];
    var parent = FREE;
    if own != FREE && atomicLoad(&clusters[own].connected) == 0u {
        parent = face;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let near = neighbours[at];
            if labels[near] == own {
                parent = min(parent, near);
            }
        }
        piece_sizes[face] = 0u;
    }
    parents[face] = parent;
}
