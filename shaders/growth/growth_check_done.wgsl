//! uses: cover
//! writes: stats, next_dispatch, boundary_list
// Last step of a pass of the growth: if no face was labelled, the passes that are still queued get no workgroups.

fn growth_check_done() {
    cover(atomicLoad(&stats[iteration.slot].moves) != 0u);
}
