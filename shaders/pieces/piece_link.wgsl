// Pieces, first step: every face of a cluster that lost one since it was known to be in one piece points to the smallest of
// itself and its neighbours in the cluster. (The steps are those of ECL-CC, Jaiganesh and Burtscher 2018.)

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(4) var<storage, read_write> parents: array<u32>;
@group(0) @binding(5) var<storage, read_write> sizes: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn piece_link(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face >= turn.faces {
        return;
    }
    let own = labels[face];
    var parent = FREE;
    if own != FREE && atomicLoad(&clusters[own].whole) == 0u {
        parent = face;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let near = neighbours[at];
            if labels[near] == own {
                parent = min(parent, near);
            }
        }
        sizes[face] = 0u;
    }
    parents[face] = parent;
}
