//! uses: iteration
// Pieces as trees over their faces: a face points to a smaller face of its piece, the smallest to itself, and a face of
// no piece to FREE.

// The smallest face of the tree of a face. Halves the path: only faces that are not roots, and never will be again, are
// set, to one further up, so the order in which threads set them does not matter.
fn root_of(face: u32) -> u32 {
    var at = face;
    var above = atomicLoad(&parents[at]);
    if above == at {
        return at;
    }
    var next = atomicLoad(&parents[above]);
    while next != above {
        atomicStore(&parents[at], next);
        at = above;
        above = next;
        next = atomicLoad(&parents[above]);
    }
    return above;
}

// The same without writing, for a kernel in which threads set faces to their roots.
fn end_of(face: u32) -> u32 {
    var at = face;
    var above = atomicLoad(&parents[at]);
    while above != at {
        at = above;
        above = atomicLoad(&parents[at]);
    }
    return above;
}
