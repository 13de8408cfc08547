//! uses: boundary_list, energy
//! reads: faces, neighbours, labels, proxies
//! writes: wanted_clusters, clusters, boundary_list
// First step of a pass of the boundary phase (P§3.2), a thread a listed face: compares the proxy of the face's
// cluster with those of its neighbours' clusters and stores the nearest. Rust: device::plain::iterate.

fn boundary_propose(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face == FREE {
        return;
    }
    let own = labels[face];
    var best = FREE;
    if own != FREE {
        let here = faces[face];
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
        if best != FREE {
            if best_cost < cost(here, proxies[own]) {
                atomicSub(&clusters[own].staying, 1u);
                atomicMin(&clusters[own].first_leaver, face);
            } else {
                best = FREE;
            }
        }
    }
    wanted_clusters[thread] = best;
}
