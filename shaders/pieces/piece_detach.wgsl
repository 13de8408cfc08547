//! uses: boundary_insert, cluster_sums
//! reads: faces, pieces
//! writes: labels, clusters, largest_pieces, stats, label_at_merge, boundary_list
// Last step, a thread a face: the faces of the other pieces become free, listed, and movers. Rust:
// device::pieces::cut_off_faces.

fn piece_detach(face: u32) {
    let root = pieces[face];
    if root == FREE || ~atomicLoad(&largest_pieces[labels[face]].inverted_root) == root {
        return;
    }
    let own = labels[face];
    labels[face] = FREE;
    add_to_cluster(own, sums_minus(NO_SUMS, sums_of(faces[face])), -1i);
    // its neighbours outside the piece belong to other clusters, so they are listed
    if claim(face, own) {
        insert(face);
    }
    atomicAdd(&stats[iteration.slot].movers, 1u);
    let place = atomicAdd(&boundary_list.lengths[movers_at()], 1u);
    boundary_list.entries[(1u - iteration.half) * iteration.faces + place] = face;
}

fn piece_detach_end(local: u32, group: u32) {
    write_inserted(local);
}
