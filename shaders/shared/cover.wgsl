// The workgroups of the indirect dispatches that follow.

// Those of so many threads.
fn cover(threads: u32) -> array<u32, 3> {
    let groups = (threads + WORKGROUP - 1u) / WORKGROUP;
    return array<u32, 3>(min(groups, turn.row), (groups + turn.row - 1u) / turn.row, 1u);
}

// As many as there are listed faces now.
fn cover_list() {
    lists.due = atomicLoad(&lists.length);
    next_dispatch = cover(lists.due);
}

fn cover_nothing() {
    next_dispatch = array<u32, 3>(0u, 0u, 0u);
}
