// Every free face and every face with a neighbour of another cluster is listed; others may be.

// The face of a thread, or FREE.
fn listed_face(thread: u32) -> u32 {
    if thread >= boundary_list.due {
        return FREE;
    }
    return boundary_list.entries[boundary_list.first + thread];
}
