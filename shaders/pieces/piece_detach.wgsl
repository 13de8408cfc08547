//! uses: boundary_insert, cluster_sums, move_count, largest_piece
// Last step, a thread a face: the faces of the other pieces become free, and are listed.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> parents: array<u32>;
@group(0) @binding(3) var<storage, read_write> labels: array<u32>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> largest_pieces: array<LargestPiece>;
@group(0) @binding(6) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(7) var<storage, read_write> label_at_merge: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn piece_detach(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(iteration, group, local);
    if face < iteration.faces {
        let root = parents[face];
        if root != FREE && ~atomicLoad(&largest_pieces[labels[face]].inverted_root) != root {
            let own = labels[face];
            labels[face] = FREE;
            add_to_cluster(own, sums_minus(NO_SUMS, sums_of(faces[face])), -1i);
            // its neighbours outside the piece belong to other clusters, so they are listed
            if claim(face, own) {
                insert(face);
            }
            atomicAdd(&moves_here, 1u);
        }
    }
    write_inserted(local);
    add_moves(local);
}
