// Third step: a face that both its clusters took wins, and whoever wants the same move joins it. `clusters` are the sums of
// the joining faces here, under the cluster that they would leave; they are zero between turns.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> offers: array<Offer>;
@group(0) @binding(4) var<storage, read_write> markets: array<Market>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;

@compute @workgroup_size(WORKGROUP)
fn join(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face >= turn.faces {
        return;
    }
    let wanted = offers[face].cluster;
    if wanted == FREE {
        return;
    }
    let own = labels[face];
    let winner = atomicLoad(&markets[own].best_face);
    // a face that both took moves between the two, but maybe the other way
    if winner == atomicLoad(&markets[wanted].best_face) && winner != FREE && labels[winner] == own {
        if winner == face {
            markets[own].dealt_in = turn.number;
            markets[own].winner = face;
            markets[own].target_cluster = wanted;
        }
        add_to_cluster(own, moment_of(faces[face]), weight_of(faces[face]), 1i);
    }
}
