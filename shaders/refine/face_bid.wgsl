//! uses: boundary_list, bids, cluster_sums
// First step of an iteration of the refinement, a thread a listed face: finds the cluster that the face gains most by
// entering, and bids at that cluster and its own.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
@group(0) @binding(4) var<storage, read> proxies: array<Proxy>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> cluster_bids: array<ClusterBids>;
@group(0) @binding(7) var<storage, read_write> face_bids: array<FaceBid>;
@group(0) @binding(8) var<storage, read_write> boundary_list: BoundaryList;

// gain·weight as a float of 7 bits of exponent and 25 of mantissa (refinement::bid).
fn packed(gain: i64, weight: u32) -> u32 {
    let drop = max(bit_length(u64(gain)), 32u) - 32u;
    let product = (u64(gain) >> drop) * u64(weight);
    let top = bit_length(product) - 1u;
    var mantissa = 0u;
    if top > 25u {
        mantissa = u32((product >> (top - 25u)) & 0x1fffffflu);
    } else {
        mantissa = u32((product << (25u - top)) & 0x1fffffflu);
    }
    return (((top + drop) << 25u) | mantissa) + 1u;
}

@compute @workgroup_size(WORKGROUP)
fn face_bid(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    if face == FREE {
        return;
    }
    if iteration.number == 1u {
        // refusals of an earlier phase
        face_bids[face].refused_in = 0u;
    }
    let own = labels[face];
    var best = FREE;
    if own != FREE && atomicLoad(&clusters[own].count) > 1u {
        let here = faces[face];
        let refused_in = face_bids[face].refused_in;
        var is_due = refused_in == 0u || cluster_bids[own].changed_in >= refused_in;
        var least = 0x7fffffffffffffffli;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let label = labels[neighbours[at]];
            if label != own && label != best && label != FREE {
                is_due |= cluster_bids[label].changed_in >= refused_in;
                let cost = cost_of_entering(here, proxies[label], cluster_weight(label));
                if cost < least || (cost == least && label < best) {
                    best = label;
                    least = cost;
                }
            }
        }
        if best != FREE {
            let gain = gain_of_leaving(here, proxies[own], cluster_weight(own)) - least;
            if is_due && gain > 0li {
                let bid = packed(gain, here.weight);
                face_bids[face].bid = bid;
                atomicMax(&cluster_bids[own].best_bid, bid);
                atomicMax(&cluster_bids[best].best_bid, bid);
            } else {
                best = FREE;
            }
        }
    }
    face_bids[face].cluster = best;
}
