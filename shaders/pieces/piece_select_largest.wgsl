//! uses: iteration, cluster, largest_piece
// Fourth step, a thread a face: of its largest pieces, a cluster keeps the one with the smallest face.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> parents: array<u32>;
@group(0) @binding(3) var<storage, read> piece_sizes: array<u32>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> largest_pieces: array<LargestPiece>;

@compute @workgroup_size(WORKGROUP)
fn piece_select_largest(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(iteration, group, local);
    if face >= iteration.faces || parents[face] != face {
        return;
    }
    let own = labels[face];
    if piece_sizes[face] == atomicLoad(&largest_pieces[own].size) {
        atomicMax(&largest_pieces[own].inverted_root, ~face);
    }
    // true once `piece_detach` has freed the other pieces
    atomicStore(&clusters[own].connected, 1u);
}
