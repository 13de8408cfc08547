//! uses: boundary_list, cluster_sums, ties, best_dual_edge
// Best dual edge of each cluster (P§5.4), a thread a listed face. Three passes find the least cost, then the least tie
// of the edges with that cost, then the smallest neighbour of those; a pass only writes its own number, the earlier
// ones are complete.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> proxies: array<Proxy>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> best_dual_edges: array<BestDualEdge>;
@group(0) @binding(6) var<storage, read_write> boundary_list: BoundaryList;

const COST: u32 = 0u;
const TIE: u32 = 1u;
const OTHER: u32 = 2u;
override PASS: u32 = COST;

// The number that this pass maximises for the edge to another cluster; 0 if an earlier pass excluded the edge.
fn rank(own: u32, other: u32) -> u32 {
    let cost = ~packed_merge_cost(proxies[own], cluster_weight(own), proxies[other], cluster_weight(other));
    if PASS == COST {
        return cost;
    }
    if cost != atomicLoad(&best_dual_edges[own].cost) {
        return 0u;
    }
    let tie = ~tie_of(own, other);
    if PASS == TIE {
        return tie;
    }
    return select(0u, ~other, tie == atomicLoad(&best_dual_edges[own].tie));
}

@compute @workgroup_size(WORKGROUP)
fn min_dual_edge(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    if face == FREE || labels[face] == FREE {
        return;
    }
    let own = labels[face];
    var best = 0u;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let other = labels[neighbours[at]];
        if other != own && other != FREE {
            best = max(best, rank(own, other));
        }
    }
    if best == 0u {
        return;
    }
    if PASS == COST {
        atomicMax(&best_dual_edges[own].cost, best);
    } else if PASS == TIE {
        atomicMax(&best_dual_edges[own].tie, best);
    } else {
        atomicMax(&best_dual_edges[own].other, best);
    }
}
