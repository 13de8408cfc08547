// Every free face and every face with a neighbour of another cluster is listed, in one half of `entries`; others may
// be. The other half has the movers: faces that want to move in this iteration, or that a repair has freed.

// Whether the phase has ended in this batch: the dispatches that are still queued do nothing then.
fn is_over() -> bool {
    return iteration.between == 0u && boundary_list.ended == iteration.batch;
}

fn listed() -> u32 {
    return select(atomicLoad(&boundary_list.lengths[iteration.half]), 0u, is_over());
}

fn listed_face(at: u32) -> u32 {
    return boundary_list.entries[iteration.half * iteration.faces + at];
}

// Index of the number of movers: two iterations in a row have different ones, and so has a repair.
fn movers_at() -> u32 {
    return select(2u + (iteration.number & 1u), 4u, iteration.between != 0u);
}

fn movers() -> u32 {
    return select(atomicLoad(&boundary_list.lengths[movers_at()]), 0u, is_over());
}

fn mover(at: u32) -> u32 {
    return boundary_list.entries[(1u - iteration.half) * iteration.faces + at];
}
