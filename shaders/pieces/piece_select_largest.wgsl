//! reads: labels, parents, piece_sizes
//! writes: clusters, largest_pieces
// Fourth step, a thread a face: of its largest pieces, a cluster keeps the one with the smallest face. Rust:
// device::pieces::cut_off_faces.

fn piece_select_largest(face: u32) {
    if parents[face] != face {
        return;
    }
    let own = labels[face];
    if piece_sizes[face] == atomicLoad(&largest_pieces[own].size) {
        atomicMax(&largest_pieces[own].inverted_root, ~face);
    }
    // true once `piece_detach` has freed the other pieces
    atomicStore(&clusters[own].connected, 1u);
}
