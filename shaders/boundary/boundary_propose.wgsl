//! uses: due_faces, energy
//! reads: faces, neighbours, labels, proxies
//! writes: wanted_clusters, clusters, boundary_list
// First step of a pass of the boundary phase (P§3.2), a thread a listed face: compares the proxy of a due face's
// cluster with those of its neighbours' clusters; a face with a nearer one becomes a mover. Rust:
// device::plain::iterate.

fn evaluate(face: u32, own: u32, visitor: u32) {
    let here = faces[face];
    var best = FREE;
    var best_cost = 0xfffffffffffffffflu;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let label = labels[neighbours[at]];
        if label == own || label == FREE {
            continue;
        }
        if !is_own_task(at, label, visitor) {
            return;
        }
        if label != best {
            let next = cost(here, proxies[label]);
            if next < best_cost || (next == best_cost && label < best) {
                best = label;
                best_cost = next;
            }
        }
    }
    atomicAdd(&due_count, 1u);
    if best != FREE && best_cost < cost(here, proxies[own]) {
        atomicSub(&clusters[own].staying, 1u);
        atomicMin(&clusters[own].first_leaver, face);
        wanted_clusters[face] = best;
        append_mover(face);
    }
}

fn boundary_propose(face: u32) {
    let own = labels[face];
    if own != FREE && has_changed(own) {
        evaluate_due(face, own);
    }
}

fn boundary_propose_end(local: u32, group: u32) {
    write_due(local);
}
