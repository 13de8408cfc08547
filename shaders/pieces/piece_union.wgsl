//! reads: neighbours, labels
//! writes: pieces
// Second step, a thread a face: for each two neighbours of a cluster, the larger root of their trees becomes a child of
// the smaller. In whatever order threads run, each tree ends as a whole piece with its smallest face as root. A thread
// whose exchange fails searches the root again; a root changes once at most. Rust: device::pieces::cut_off_faces.

// The smallest face of the tree of a face. Halves the path: only faces that are not roots, and never will be again, are
// set, to one further up, so the order in which threads set them does not matter.
fn root_of(face: u32) -> u32 {
    var at = face;
    var above = atomicLoad(&pieces[at]);
    if above == at {
        return at;
    }
    var next = atomicLoad(&pieces[above]);
    while next != above {
        atomicStore(&pieces[at], next);
        at = above;
        above = next;
        next = atomicLoad(&pieces[above]);
    }
    return above;
}

fn piece_union(face: u32) {
    if atomicLoad(&pieces[face]) == FREE {
        return;
    }
    let own = labels[face];
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if near < face && labels[near] == own {
            var a = root_of(face);
            var b = root_of(near);
            while a != b {
                let high = max(a, b);
                let low = min(a, b);
                if atomicCompareExchangeWeak(&pieces[high], high, low).exchanged {
                    break;
                }
                a = root_of(high);
                b = root_of(low);
            }
        }
    }
}
