//! uses: boundary_list, candidate_edge
// The cheapest dual edge of all, second step, one workgroup: the best of the candidates. It is written to the first
// place, which the writing thread has read by then.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> candidate_edges: array<CandidateEdge>;
@group(0) @binding(2) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn cheapest_dual_edge_reduce(@builtin(local_invocation_index) local: u32) {
    var best = NO_CANDIDATE;
    // one for each workgroup of `cheapest_dual_edge`
    for (var at = local; at * WORKGROUP < boundary_list.due; at += WORKGROUP) {
        let cost = candidate_edges[at].cost;
        let next = Candidate(
            (u64(cost[3]) << 32u) | u64(cost[2]),
            (u64(cost[1]) << 32u) | u64(cost[0]),
            candidate_edges[at].tie,
            candidate_edges[at].low,
            candidate_edges[at].high,
        );
        if is_better(next, best) {
            best = next;
        }
    }
    write_best(local, best, 0u);
}
