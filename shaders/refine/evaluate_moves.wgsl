// Fourth step, a thread a cluster: where a face won a move from here, compares the energy of the two clusters before and
// after, exactly, with all that joined and with the winner alone, and brings sums and proxies up to date. No other thread
// touches the two clusters: each is part of one deal at most.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> joining: array<Cluster>;
@group(0) @binding(4) var<storage, read_write> proxies: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read_write> markets: array<Market>;
@group(0) @binding(6) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(7) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(8) var<storage, read_write> lists: Lists;

// Faces on their way.
struct Change {
    sum: vec3<i64>,
    weight: i64,
    count: u32,
}

var<workgroup> moved: atomic<u32>;

// Reads the sums of the joining faces and clears them for the next turn.
fn take_joining(cluster: u32) -> Change {
    var change = Change(vec3<i64>(0li, 0li, 0li), 0li, 0u);
    for (var axis = 0u; axis < 3u; axis++) {
        let low = u64(atomicExchange(&joining[cluster].sum[2u * axis], 0u));
        let high = u64(atomicExchange(&joining[cluster].sum[2u * axis + 1u], 0u));
        change.sum[axis] = i64((high << 32u) | low);
    }
    let low = u64(atomicExchange(&joining[cluster].weight[0], 0u));
    let high = u64(atomicExchange(&joining[cluster].weight[1], 0u));
    change.weight = i64((high << 32u) | low);
    change.count = atomicExchange(&joining[cluster].count, 0u);
    return change;
}

fn energy_with(sum: vec3<i64>, weight: i64) -> Wide {
    return explained_by(proxy_of(sum, weight), sum, weight);
}

// What the explained energy rises by; nothing when no face would be left.
fn rise(before: Wide, from_cluster: u32, into: u32, change: Change) -> Wide {
    if atomicLoad(&clusters[from_cluster].count) <= change.count {
        return Wide(0li, 0li);
    }
    let rest = energy_with(sum_of(from_cluster) - change.sum, weight_in(from_cluster) - change.weight);
    let whole = energy_with(sum_of(into) + change.sum, weight_in(into) + change.weight);
    return minus(plus(rest, whole), before);
}

// Replaces the sums of a cluster, and its proxy.
fn settle_cluster(cluster: u32, sum: vec3<i64>, weight: i64, count: u32) {
    for (var axis = 0u; axis < 3u; axis++) {
        let bits = u64(sum[axis]);
        atomicStore(&clusters[cluster].sum[2u * axis], u32(bits & 0xfffffffflu));
        atomicStore(&clusters[cluster].sum[2u * axis + 1u], u32(bits >> 32u));
    }
    let bits = u64(weight);
    atomicStore(&clusters[cluster].weight[0], u32(bits & 0xfffffffflu));
    atomicStore(&clusters[cluster].weight[1], u32(bits >> 32u));
    atomicStore(&clusters[cluster].count, count);
    let proxy = proxy_of(sum, weight);
    proxies[cluster] = vec4<i32>(i32(proxy.x), i32(proxy.y), i32(proxy.z), proxies[cluster].w);
    markets[cluster].changed_in = turn.number;
}

// Decides about the deal of a cluster. Returns the rise.
fn decide(own: u32) -> Wide {
    let into = markets[own].target_cluster;
    let before = plus(
        energy_with(sum_of(own), weight_in(own)),
        energy_with(sum_of(into), weight_in(into)),
    );
    var change = take_joining(own);
    var verdict = ALL_MOVE;
    var energy = rise(before, own, into, change);
    if !is_positive(energy) {
        let winner = faces[markets[own].winner];
        change = Change(moment_of(winner), weight_of(winner), 1u);
        verdict = WINNER_MOVES;
        energy = rise(before, own, into, change);
    }
    if is_positive(energy) {
        let left = atomicLoad(&clusters[own].count) - change.count;
        let then = atomicLoad(&clusters[into].count) + change.count;
        settle_cluster(own, sum_of(own) - change.sum, weight_in(own) - change.weight, left);
        settle_cluster(into, sum_of(into) + change.sum, weight_in(into) + change.weight, then);
        atomicStore(&clusters[own].whole, 0u);
        atomicAdd(&moved, change.count);
    } else {
        verdict = REFUSED;
        energy = Wide(0li, 0li);
    }
    markets[own].verdict = verdict;
    return energy;
}

@compute @workgroup_size(WORKGROUP)
fn evaluate_moves(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(turn, group, local);
    let cluster = living_cluster(thread);
    // complete since `select_bids`; nothing here writes it
    let live = atomicLoad(&ring[turn.slot].bids) != 0u;
    if thread == 0u {
        if live {
            cover_list();
        } else {
            cover_nothing();
        }
    }
    var energy = Wide(0li, 0li);
    var shift = 0u;
    if live && cluster != FREE {
        if markets[cluster].dealt_in == turn.number {
            // both clusters lie in one component: the shift is the same
            shift = u32(proxies[cluster].w);
            energy = decide(cluster);
        }
        atomicStore(&markets[cluster].best_bid, 0u);
        atomicStore(&markets[cluster].best_face, FREE);
    }
    report_energy(local, energy, shift);
    if local == 0u {
        let here = atomicLoad(&moved);
        if here != 0u {
            atomicAdd(&ring[turn.slot].moves, here);
        }
    }
}
