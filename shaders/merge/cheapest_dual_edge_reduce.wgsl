// The cheapest dual edge of all, second step, one workgroup: the best of what the workgroups of `cheapest_dual_edge` found. It ends up in
// the first place, which the thread that writes it has read by then.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> bests: array<Best>;
@group(0) @binding(2) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn cheapest_dual_edge_reduce(@builtin(local_invocation_index) local: u32) {
    var best = NO_CANDIDATE;
    // one for each workgroup of `cheapest_dual_edge`
    for (var at = local; at * WORKGROUP < lists.due; at += WORKGROUP) {
        let cost = bests[at].cost;
        let next = Candidate(
            (u64(cost[3]) << 32u) | u64(cost[2]),
            (u64(cost[1]) << 32u) | u64(cost[0]),
            bests[at].tie,
            bests[at].low,
            bests[at].high,
        );
        if is_better(next, best) {
            best = next;
        }
    }
    report_best(local, best, 0u);
}
