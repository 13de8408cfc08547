//! uses: append, energy
//! reads: faces, neighbours, labels, proxies
//! writes: wanted_clusters, clusters, boundary_list
// First step of a pass of the boundary phase (P§3.2), a thread a listed face: compares the proxy of the face's
// cluster with those of its neighbours' clusters; a face with a nearer one becomes a mover. Rust:
// device::plain::iterate.

fn boundary_propose(face: u32) {
    let own = labels[face];
    if own == FREE {
        return;
    }
    let here = faces[face];
    var best = FREE;
    var best_cost = 0xfffffffffffffffflu;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let label = labels[neighbours[at]];
        if label != own && label != best && label != FREE {
            let next = cost(here, proxies[label]);
            if next < best_cost || (next == best_cost && label < best) {
                best = label;
                best_cost = next;
            }
        }
    }
    if best != FREE && best_cost < cost(here, proxies[own]) {
        atomicSub(&clusters[own].staying, 1u);
        atomicMin(&clusters[own].first_leaver, face);
        wanted_clusters[face] = best;
        append_mover(face);
    }
}

fn boundary_propose_end(local: u32, group: u32) {
    write_movers(local);
}
