//! uses: boundary_list, candidate_edge
//! writes: candidate_edges, boundary_list
// The cheapest dual edge of all (P§5.4), second step, one workgroup: the best of the candidates. It is written to the
// first place, which the writing thread has read by then. Rust: device::cheapest_dual_edge.

fn cheapest_dual_edge_reduce(thread: u32, local: u32) {
    var best = NO_CANDIDATE;
    // one for each workgroup of `cheapest_dual_edge`
    for (var at = local; at * WORKGROUP < boundary_list.due; at += WORKGROUP) {
        let next = candidate_edges[at];
        if is_better(next, best) {
            best = next;
        }
    }
    write_best(local, best, 0u);
}
