// First step of an iteration of the refinement: every listed face finds the cluster to which its move gains most, and tells both
// clusters how much.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
@group(0) @binding(4) var<storage, read> proxies: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> markets: array<Market>;
@group(0) @binding(7) var<storage, read_write> offers: array<Offer>;
@group(0) @binding(8) var<storage, read_write> lists: Lists;

// distance·weight / rest, the quotient of the last two a fraction of 32 bits and below 1.
fn scaled(distance: u64, weight: u64, rest: u64) -> u64 {
    let fraction = min((weight << 32u) / rest, 0xfffffffflu);
    return (distance >> 32u) * fraction + (((distance & 0xfffffffflu) * fraction) >> 32u);
}

// What leaving a cluster gains, and what entering one costs, per weight (refinement::gain).
fn leaving(face: vec4<i32>, cluster: u32) -> i64 {
    let weight = u64(u32(face.w));
    let distance = distance_squared(face, proxies[cluster]);
    return i64(distance + scaled(distance, weight, u64(weight_in(cluster)) - weight));
}

fn entering(face: vec4<i32>, cluster: u32) -> i64 {
    let weight = u64(u32(face.w));
    let distance = distance_squared(face, proxies[cluster]);
    return i64(distance - scaled(distance, weight, u64(weight_in(cluster)) + weight));
}

// gain·weight as a float of 7 bits of exponent and 25 of mantissa (refinement::bid).
fn packed(gain: i64, weight: u32) -> u32 {
    let drop = max(length(u64(gain)), 32u) - 32u;
    let product = (u64(gain) >> drop) * u64(weight);
    let top = length(product) - 1u;
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
    let face = listed_face(thread_number(turn, group, local));
    if face == FREE {
        return;
    }
    if turn.number == 1u {
        // what was refused in another phase
        offers[face].refused_in = 0u;
    }
    let own = labels[face];
    var best = FREE;
    if own != FREE && atomicLoad(&clusters[own].count) > 1u {
        let here = faces[face];
        let refused_in = offers[face].refused_in;
        var is_due = refused_in == 0u || markets[own].changed_in >= refused_in;
        var least = 0x7fffffffffffffffli;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let label = labels[neighbours[at]];
            if label != own && label != best && label != FREE {
                is_due |= markets[label].changed_in >= refused_in;
                let cost = entering(here, label);
                if cost < least || (cost == least && label < best) {
                    best = label;
                    least = cost;
                }
            }
        }
        if best != FREE {
            let gain = leaving(here, own) - least;
            if is_due && gain > 0li {
                let bid = packed(gain, u32(here.w));
                offers[face].bid = bid;
                atomicMax(&markets[own].best_bid, bid);
                atomicMax(&markets[best].best_bid, bid);
            } else {
                best = FREE;
            }
        }
    }
    offers[face].cluster = best;
}
