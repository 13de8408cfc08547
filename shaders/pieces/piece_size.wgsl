//! reads: labels
//! writes: pieces, largest_pieces
// Third step: sets every face to its root, counts the faces of each piece, and finds the size of each cluster's largest
// piece. A thread takes a few faces in a row, as in `sums_gather`. Rust: device::pieces::cut_off_faces.

// The smallest face of the tree of a face. No path is halved, as in `piece_union`: threads set faces to their roots.
fn end_of(face: u32) -> u32 {
    var at = face;
    var above = atomicLoad(&pieces[at]);
    while above != at {
        at = above;
        above = atomicLoad(&pieces[at]);
    }
    return above;
}

// The last addition to a piece finds its whole size.
fn add_to_piece(root: u32, faces: u32) {
    let before = atomicAdd(&pieces[iteration.faces + root], faces);
    atomicMax(&largest_pieces[labels[root]].size, before + faces);
}

fn piece_size(run: u32) {
    let first = run * RUN;
    let end = min(first + RUN, iteration.faces);
    var root = FREE;
    var faces = 0u;
    for (var face = first; face < end; face++) {
        if atomicLoad(&pieces[face]) == FREE {
            continue;
        }
        let next = end_of(face);
        atomicStore(&pieces[face], next);
        if next != root {
            if root != FREE {
                add_to_piece(root, faces);
            }
            root = next;
            faces = 0u;
        }
        faces += 1u;
    }
    if root != FREE {
        add_to_piece(root, faces);
    }
}
