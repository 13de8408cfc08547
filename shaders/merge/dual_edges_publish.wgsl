//! uses: boundary_list, best_dual_edge
// Best dual edges, last step, a thread a cluster that is left: writes them for the host, in the order of the clusters,
// and clears them for the next search.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> best_dual_edges: array<BestDualEdge>;
@group(0) @binding(2) var<storage, read_write> dual_edges: array<DualEdge>;
@group(0) @binding(3) var<storage, read_write> boundary_list: BoundaryList;

// Rust: layout::DualEdge.
struct DualEdge {
    // FREE without an edge.
    other: u32,
    // The packed cost.
    cost: u32,
}

@compute @workgroup_size(WORKGROUP)
fn dual_edges_publish(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let cluster = living_cluster(thread);
    if cluster == FREE {
        return;
    }
    let cost = atomicExchange(&best_dual_edges[cluster].cost, 0u);
    let other = atomicExchange(&best_dual_edges[cluster].other, 0u);
    atomicStore(&best_dual_edges[cluster].tie, 0u);
    dual_edges[thread] = DualEdge(select(FREE, ~other, cost != 0u), ~cost);
}
