// Pieces, fourth step: of its largest pieces, a cluster keeps the one with the smallest face. `best_bid` is complete since
// `piece_size`; nothing here writes it.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> parents: array<u32>;
@group(0) @binding(3) var<storage, read> sizes: array<u32>;
@group(0) @binding(4) var<storage, read_write> markets: array<Market>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;

@compute @workgroup_size(WORKGROUP)
fn piece_select_largest(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face >= turn.faces || parents[face] != face {
        return;
    }
    let own = labels[face];
    if sizes[face] == atomicLoad(&markets[own].best_bid) {
        atomicMin(&markets[own].best_face, face);
    }
    // it will be, once `piece_detach` has freed the others
    atomicStore(&clusters[own].whole, 1u);
}
