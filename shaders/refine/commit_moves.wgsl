//! uses: boundary_list, bids
// Last step, a thread a listed face: labels follow the accepted moves, and a winner that was refused remembers when.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> labels: array<u32>;
@group(0) @binding(2) var<storage, read_write> face_bids: array<FaceBid>;
@group(0) @binding(3) var<storage, read_write> cluster_bids: array<ClusterBids>;
@group(0) @binding(4) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn commit_moves(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    if face == FREE {
        return;
    }
    let wanted = face_bids[face].cluster;
    if wanted == FREE {
        return;
    }
    let own = labels[face];
    if cluster_bids[own].won_in != iteration.number || cluster_bids[own].target_cluster != wanted {
        return;
    }
    let accepted = cluster_bids[own].accepted;
    let is_winner = cluster_bids[own].winner == face;
    if accepted == ALL_MOVE || (accepted == WINNER_MOVES && is_winner) {
        labels[face] = wanted;
    } else if accepted == REFUSED && is_winner {
        face_bids[face].refused_in = iteration.number;
    }
}
