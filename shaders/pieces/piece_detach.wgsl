//! uses: boundary_insert, cluster_sums, count
//! reads: faces, parents
//! writes: labels, clusters, largest_pieces, stats, label_at_merge, boundary_list
// Last step, a thread a face: the faces of the other pieces become free, and are listed. Rust:
// device::pieces::cut_off_faces.

fn piece_detach(face: u32, local: u32) {
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
            atomicAdd(&counted, 1u);
        }
    }
    write_inserted(local);
    add_moves(local);
}
