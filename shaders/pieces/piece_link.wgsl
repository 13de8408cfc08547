//! reads: neighbours, labels
//! writes: clusters, pieces
// Connected pieces of clusters, first step, a thread a face (ECL-CC, Jaiganesh and Burtscher 2018): a face of a cluster
// that is not known to be connected points to the smallest of itself and its neighbours in the cluster. Rust:
// device::pieces::cut_off_faces.

fn piece_link(face: u32) {
    let own = labels[face];
    var parent = FREE;
    if own != FREE && atomicLoad(&clusters[own].connected) == 0u {
        parent = face;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let near = neighbours[at];
            if labels[near] == own {
                parent = min(parent, near);
            }
        }
        atomicStore(&pieces[iteration.faces + face], 0u);
    }
    atomicStore(&pieces[face], parent);
}
