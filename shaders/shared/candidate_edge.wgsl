// The cheapest dual edge of a workgroup, in the order of device::dual_edge::Rank: cost, tie, ends.

const NO_CANDIDATE = CandidateEdge(0xfffffffffffffffflu, 0xfffffffffffffffflu, FREE, FREE, FREE, 0u);

var<private> best_candidate: CandidateEdge = NO_CANDIDATE;
var<workgroup> candidates: array<CandidateEdge, WORKGROUP>;

fn is_better(a: CandidateEdge, b: CandidateEdge) -> bool {
    if a.high_cost != b.high_cost {
        return a.high_cost < b.high_cost;
    }
    if a.low_cost != b.low_cost {
        return a.low_cost < b.low_cost;
    }
    if a.tie != b.tie {
        return a.tie < b.tie;
    }
    return a.low < b.low || (a.low == b.low && a.high < b.high);
}

// Keeps the better of a candidate and the best one of this thread.
fn keep_better(next: CandidateEdge) {
    if is_better(next, best_candidate) {
        best_candidate = next;
    }
}

// Writes the best candidate of all threads of the workgroup. Every thread must call this.
fn write_best(local: u32, place: u32) {
    candidates[local] = best_candidate;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half && is_better(candidates[local + half], candidates[local]) {
            candidates[local] = candidates[local + half];
        }
    }
    if local == 0u {
        candidate_edges[place] = candidates[0];
    }
}
