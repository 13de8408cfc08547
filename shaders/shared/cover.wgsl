// The workgroups of the indirect dispatches that follow.

// As many as there are listed faces now.
fn cover_list() {
    lists.due = atomicLoad(&lists.length);
    let groups = (lists.due + WORKGROUP - 1u) / WORKGROUP;
    next_dispatch = array<u32, 3>(min(groups, turn.row), (groups + turn.row - 1u) / turn.row, 1u);
}

fn cover_nothing() {
    next_dispatch = array<u32, 3>(0u, 0u, 0u);
}
