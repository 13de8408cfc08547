// Pieces as trees over their faces: a face points to a smaller one of its piece, the smallest to itself. A face that nobody
// asks about points to FREE.

// The smallest face of the tree that a face is in. Halves the way there for all who come after: only faces that are no roots,
// and never will be again, are turned, to one further up, so it does not matter who turns them last.
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

// The same, on a way that nobody changes but to its end: turns nothing, so that a face may be turned to what was found.
fn end_of(face: u32) -> u32 {
    var at = face;
    var above = atomicLoad(&parents[at]);
    while above != at {
        at = above;
        above = atomicLoad(&parents[at]);
    }
    return at;
}
