//! uses: boundary_list, cluster_sums, ties
//! reads: neighbours, labels, proxies, cluster_numbers
//! writes: clusters, best_dual_edges, boundary_list
// Best dual edge of each cluster (P§5.4), a thread a listed face. Three passes find the least cost, then the least tie
// of the edges with that cost, then the smallest neighbour of those; a pass only writes its own number, the earlier
// ones are complete. Rust: device::optimal_dual_edges.

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

fn min_dual_edge(face: u32) {
    let own = labels[face];
    if own == FREE {
        return;
    }
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
