//! reads: labels, pieces
//! writes: clusters, largest_pieces
// Fourth step, a thread a face: of its largest pieces, a cluster keeps the one with the smallest face. Rust:
// device::pieces::cut_off_faces.

fn piece_select_largest(face: u32) {
    if pieces[face] != face {
        return;
    }
    let own = labels[face];
    if pieces[iteration.faces + face] == atomicLoad(&largest_pieces[own].size) {
        atomicMax(&largest_pieces[own].inverted_root, ~face);
    }
    // true once `piece_detach` has freed the other pieces
    atomicStore(&clusters[own].connected, 1u);
}
