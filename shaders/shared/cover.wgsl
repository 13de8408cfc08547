//! uses: boundary_list
// The size of the indirect dispatches that follow.

// One thread for each face that is listed now.
fn cover_list() {
    boundary_list.due = atomicLoad(&boundary_list.length);
    let groups = (boundary_list.due + WORKGROUP - 1u) / WORKGROUP;
    let row = iteration.row;
    next_dispatch = array<u32, 3>(min(groups, row), (groups + row - 1u) / row, 1u);
}

fn cover_nothing() {
    next_dispatch = array<u32, 3>(0u, 0u, 0u);
}
