//! uses: copied_sums
//! reads: living_clusters
//! writes: best_dual_edges, dual_edges, clusters, copied_sums
// Best dual edges (P§5.4), last step, a thread a cluster that is left: writes them for the host, in the order of the
// clusters, with the sums of as many clusters as the host wants, and clears them for the next search.
// Rust: device::optimal_dual_edges.

fn dual_edges_publish(at: u32) {
    let cluster = living_clusters[at];
    let cost = atomicExchange(&best_dual_edges[cluster].cost, 0u);
    let other = atomicExchange(&best_dual_edges[cluster].other, 0u);
    atomicStore(&best_dual_edges[cluster].tie, 0u);
    dual_edges[at] = DualEdge(select(FREE, ~other, cost != 0u), ~cost);
    if at < iteration.entries {
        copy_sums(cluster, at);
    }
}
