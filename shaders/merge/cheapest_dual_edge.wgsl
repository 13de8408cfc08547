//! uses: boundary_list, cluster_sums, ties, candidate_edge
//! reads: neighbours, labels, proxies, cluster_numbers
//! writes: clusters, candidate_edges, boundary_list
// The cheapest dual edge of all (P§5.4), first step, a thread a listed face: the best of each workgroup, by exact cost.
// Rust: device::cheapest_dual_edge.

fn candidate(own: u32, other: u32) -> CandidateEdge {
    let cost = exact_merge_cost(proxies[own], cluster_weight(own), proxies[other], cluster_weight(other));
    let low = min(own, other);
    let high = max(own, other);
    return CandidateEdge(cost.x, cost.y, tie_of(low, high), low, high, 0u);
}

fn cheapest_dual_edge(face: u32) {
    let own = labels[face];
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let other = labels[neighbours[at]];
        // faces of the other cluster have the same edge
        if own < other && other != FREE {
            keep_better(candidate(own, other));
        }
    }
}

fn cheapest_dual_edge_end(local: u32, group: u32) {
    write_best(local, group);
}
