// Sets the size of the indirect dispatches that follow, in one thread: a thread for each face that is listed now, or
// none.
fn cover(is_going_on: bool) {
    var groups = 0u;
    if is_going_on {
        boundary_list.due = atomicLoad(&boundary_list.length);
        groups = (boundary_list.due + WORKGROUP - 1u) / WORKGROUP;
    }
    next_dispatch = array<u32, 3>(min(groups, iteration.row), (groups + iteration.row - 1u) / iteration.row, 1u);
}
