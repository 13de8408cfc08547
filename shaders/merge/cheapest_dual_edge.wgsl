//! uses: boundary_list, cluster_sums, ties, candidate_edge
// The cheapest dual edge of all (P§5.4), first step, a thread a listed face: the best of each workgroup, by exact cost.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> proxies: array<Proxy>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> candidate_edges: array<CandidateEdge>;
@group(0) @binding(6) var<storage, read_write> boundary_list: BoundaryList;

fn candidate(own: u32, other: u32) -> Candidate {
    let cost = exact_merge_cost(proxies[own], cluster_weight(own), proxies[other], cluster_weight(other));
    let low = min(own, other);
    let high = max(own, other);
    return Candidate(cost.x, cost.y, tie_of(low, high), low, high);
}

@compute @workgroup_size(WORKGROUP)
fn cheapest_dual_edge(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    var best = NO_CANDIDATE;
    if face != FREE {
        let own = labels[face];
        if own != FREE {
            let end = neighbours[face + 1u];
            for (var at = neighbours[face]; at < end; at++) {
                let other = labels[neighbours[at]];
                // the faces of the other cluster look at this one, too
                if own < other && other != FREE {
                    let next = candidate(own, other);
                    if is_better(next, best) {
                        best = next;
                    }
                }
            }
        }
    }
    write_best(local, best, group.y * iteration.row + group.x);
}
