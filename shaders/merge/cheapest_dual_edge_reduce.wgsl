//! uses: candidate_edge, copied_sums
//! writes: candidate_edges, clusters, copied_sums
// The cheapest dual edge of all (P§5.4), second step, one workgroup: the best of the candidates, and the sums of its
// ends for the host. It is written to the first place, which the writing thread has read by then.
// Rust: device::cheapest_dual_edge.

// One for each workgroup of `cheapest_dual_edge`.
fn cheapest_dual_edge_reduce(at: u32) {
    keep_better(candidate_edges[at]);
}

fn cheapest_dual_edge_reduce_end(local: u32, group: u32) {
    write_best(local, 0u);
    if local == 0u && candidates[0].low != FREE {
        copy_sums(candidates[0].low, 0u);
        copy_sums(candidates[0].high, 1u);
    }
}
