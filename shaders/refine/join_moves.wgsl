//! uses: boundary_insert, bids, cluster_sums
// Third step, a thread a listed face: a face that both its clusters took wins, and faces that want the same move join
// it. `clusters` is bound to the sums of the joining faces, under the cluster that they leave; they are zero between
// iterations.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
@group(0) @binding(4) var<storage, read_write> face_bids: array<FaceBid>;
@group(0) @binding(5) var<storage, read_write> cluster_bids: array<ClusterBids>;
@group(0) @binding(6) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(7) var<storage, read_write> label_at_merge: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> boundary_list: BoundaryList;

// Adds a face to the move of its cluster's winner, if it wants the same. Its neighbours inside the cluster are listed
// before the move is accepted; if it is refused, they are evaluated once more without effect.
fn join_winner(face: u32) {
    let wanted = face_bids[face].cluster;
    if wanted == FREE {
        return;
    }
    let own = labels[face];
    let winner = atomicLoad(&cluster_bids[own].best_face);
    // a face that both clusters took moves between the two, but maybe in the other direction
    if winner != atomicLoad(&cluster_bids[wanted].best_face) || winner == FREE || labels[winner] != own {
        return;
    }
    if winner == face {
        cluster_bids[own].won_in = iteration.number;
        cluster_bids[own].winner = face;
        cluster_bids[own].target_cluster = wanted;
    }
    add_to_cluster(own, sums_of(faces[face]), 1i);
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if claim(near, own) {
            face_bids[near] = FaceBid(FREE, 0u, 0u);
            insert(near);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn join_moves(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    if face != FREE {
        join_winner(face);
    }
    write_inserted(local);
}
