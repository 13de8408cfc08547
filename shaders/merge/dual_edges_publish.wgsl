//! uses: living_clusters
//! reads: living_clusters
//! writes: best_dual_edges, dual_edges
// Best dual edges (P§5.4), last step, a thread a cluster that is left: writes them for the host, in the order of the
// clusters, and clears them for the next search. Rust: device::optimal_dual_edges.

fn dual_edges_publish(thread: u32, local: u32) {
    let cluster = living_cluster(thread);
    if cluster == FREE {
        return;
    }
    let cost = atomicExchange(&best_dual_edges[cluster].cost, 0u);
    let other = atomicExchange(&best_dual_edges[cluster].other, 0u);
    atomicStore(&best_dual_edges[cluster].tie, 0u);
    dual_edges[thread] = DualEdge(select(FREE, ~other, cost != 0u), ~cost);
}
