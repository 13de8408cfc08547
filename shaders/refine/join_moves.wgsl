// Third step: a face that both its clusters took wins, and whoever wants the same move joins it. `clusters` are the sums of
// the joining faces here, under the cluster that they would leave; they are zero between turns.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> offers: array<Offer>;
@group(0) @binding(4) var<storage, read_write> markets: array<Market>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read> neighbours: array<u32>;
@group(0) @binding(7) var<storage, read_write> origins: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> lists: Lists;

// Joins those who make a face's move, if one won it. Neighbours that will see another cluster when it moves are listed already
// now: should it not, they only look once more.
fn join_winner(face: u32) {
    let wanted = offers[face].cluster;
    if wanted == FREE {
        return;
    }
    let own = labels[face];
    let winner = atomicLoad(&markets[own].best_face);
    // a face that both took moves between the two, but maybe the other way
    if winner != atomicLoad(&markets[wanted].best_face) || winner == FREE || labels[winner] != own {
        return;
    }
    if winner == face {
        markets[own].dealt_in = turn.number;
        markets[own].winner = face;
        markets[own].target_cluster = wanted;
    }
    add_to_cluster(own, moment_of(faces[face]), weight_of(faces[face]), 1i);
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if claim(near, own) {
            offers[near] = Offer(FREE, 0u, 0u);
            add_newcomer(near);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn join_moves(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face != FREE {
        join_winner(face);
    }
    list_newcomers(local);
}
