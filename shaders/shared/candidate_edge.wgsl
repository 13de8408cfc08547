//! uses: iteration
// The best dual edge of a workgroup, by exact cost (cluster::dual_edge::Rank). Rust: layout::CandidateEdge.
struct CandidateEdge {
    // Cost, 128 bits, low word first.
    cost: array<u32, 4>,
    // Of equal costs the smallest tie wins, then the smallest ends. `low` is FREE where there is no edge.
    tie: u32,
    low: u32,
    high: u32,
    unused: u32,
}

// The same for one thread.
struct Candidate {
    high_cost: u64,
    low_cost: u64,
    tie: u32,
    low: u32,
    high: u32,
}

const NO_CANDIDATE = Candidate(0xfffffffffffffffflu, 0xfffffffffffffffflu, FREE, FREE, FREE);

var<workgroup> candidates: array<Candidate, WORKGROUP>;

fn is_better(a: Candidate, b: Candidate) -> bool {
    if a.high_cost != b.high_cost {
        return a.high_cost < b.high_cost;
    }
    if a.low_cost != b.low_cost {
        return a.low_cost < b.low_cost;
    }
    if a.tie != b.tie {
        return a.tie < b.tie;
    }
    if a.low != b.low {
        return a.low < b.low;
    }
    return a.high < b.high;
}

// Writes the best candidate of all threads of the workgroup. Every thread must call this.
fn write_best(local: u32, own: Candidate, place: u32) {
    candidates[local] = own;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half && is_better(candidates[local + half], candidates[local]) {
            candidates[local] = candidates[local + half];
        }
    }
    if local == 0u {
        let best = candidates[0];
        let cost = array<u32, 4>(
            u32(best.low_cost & 0xfffffffflu),
            u32(best.low_cost >> 32u),
            u32(best.high_cost & 0xfffffffflu),
            u32(best.high_cost >> 32u),
        );
        candidate_edges[place] = CandidateEdge(cost, best.tie, best.low, best.high, 0u);
    }
}
