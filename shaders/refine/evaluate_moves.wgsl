//! uses: bids, cluster_sums, energy_total, move_count, cover
// Fourth step, a thread a cluster: if a face won a move out of the cluster, compares the energy of the two clusters
// before and after, exactly, with all joining faces and then with the winner alone, and updates sums and proxies. A
// cluster is in one move at most, so no other thread touches the two.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> joining_sums: array<Cluster>;
@group(0) @binding(4) var<storage, read_write> proxies: array<Proxy>;
@group(0) @binding(5) var<storage, read_write> cluster_bids: array<ClusterBids>;
@group(0) @binding(6) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(7) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(8) var<storage, read_write> boundary_list: BoundaryList;

// Faces that move together.
struct Change {
    sums: Sums,
    count: u32,
}

fn take_word(low: u32, high: u32) -> i64 {
    return i64((u64(high) << 32u) | u64(low));
}

// Reads the sums of the joining faces and clears them for the next iteration.
fn take_joining(cluster: u32) -> Change {
    let x = take_word(
        atomicExchange(&joining_sums[cluster].moment[0], 0u),
        atomicExchange(&joining_sums[cluster].moment[1], 0u),
    );
    let y = take_word(
        atomicExchange(&joining_sums[cluster].moment[2], 0u),
        atomicExchange(&joining_sums[cluster].moment[3], 0u),
    );
    let z = take_word(
        atomicExchange(&joining_sums[cluster].moment[4], 0u),
        atomicExchange(&joining_sums[cluster].moment[5], 0u),
    );
    let weight = take_word(
        atomicExchange(&joining_sums[cluster].weight[0], 0u),
        atomicExchange(&joining_sums[cluster].weight[1], 0u),
    );
    return Change(Sums(vec3<i64>(x, y, z), weight), atomicExchange(&joining_sums[cluster].count, 0u));
}

// The rise of the explained energy; none if no face would be left.
fn rise(before: Wide, from_cluster: u32, into: u32, change: Change) -> Wide {
    if atomicLoad(&clusters[from_cluster].count) <= change.count {
        return Wide(0li, 0li);
    }
    let rest = explained(sums_minus(cluster_sums(from_cluster), change.sums));
    let whole = explained(sums_plus(cluster_sums(into), change.sums));
    return minus(plus(rest, whole), before);
}

fn store_moment(cluster: u32, axis: u32, value: i64) {
    atomicStore(&clusters[cluster].moment[2u * axis], u32(u64(value) & 0xfffffffflu));
    atomicStore(&clusters[cluster].moment[2u * axis + 1u], u32(u64(value) >> 32u));
}

// Replaces the sums of a cluster, and its proxy.
fn store_cluster(cluster: u32, sums: Sums, count: u32) {
    store_moment(cluster, 0u, sums.moment.x);
    store_moment(cluster, 1u, sums.moment.y);
    store_moment(cluster, 2u, sums.moment.z);
    atomicStore(&clusters[cluster].weight[0], u32(u64(sums.weight) & 0xfffffffflu));
    atomicStore(&clusters[cluster].weight[1], u32(u64(sums.weight) >> 32u));
    atomicStore(&clusters[cluster].count, count);
    proxies[cluster] = fitted_proxy(fit(sums), proxies[cluster].energy_shift);
    cluster_bids[cluster].changed_in = iteration.number;
}

// Decides about the move out of a cluster. Returns the rise of the explained energy.
fn evaluate(own: u32) -> Wide {
    let into = cluster_bids[own].target_cluster;
    let before = plus(explained(cluster_sums(own)), explained(cluster_sums(into)));
    var change = take_joining(own);
    var accepted = ALL_MOVE;
    var energy = rise(before, own, into, change);
    if !is_positive(energy) {
        change = Change(sums_of(faces[cluster_bids[own].winner]), 1u);
        accepted = WINNER_MOVES;
        energy = rise(before, own, into, change);
    }
    if is_positive(energy) {
        let left = atomicLoad(&clusters[own].count) - change.count;
        let then = atomicLoad(&clusters[into].count) + change.count;
        store_cluster(own, sums_minus(cluster_sums(own), change.sums), left);
        store_cluster(into, sums_plus(cluster_sums(into), change.sums), then);
        atomicStore(&clusters[own].connected, 0u);
        atomicAdd(&moves_here, change.count);
    } else {
        accepted = REFUSED;
        energy = Wide(0li, 0li);
    }
    cluster_bids[own].accepted = accepted;
    return energy;
}

@compute @workgroup_size(WORKGROUP)
fn evaluate_moves(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let cluster = living_cluster(thread);
    // the bids are complete since `select_bids`
    let goes_on = atomicLoad(&stats[iteration.slot].bids) != 0u;
    if thread == 0u {
        if goes_on {
            cover_list();
        } else {
            cover_nothing();
        }
    }
    var energy = Wide(0li, 0li);
    var shift = 0u;
    if goes_on && cluster != FREE {
        if cluster_bids[cluster].won_in == iteration.number {
            // both clusters lie in one component, so the shift is the same
            shift = proxies[cluster].energy_shift;
            energy = evaluate(cluster);
        }
        atomicStore(&cluster_bids[cluster].best_bid, 0u);
        atomicStore(&cluster_bids[cluster].best_face, FREE);
    }
    add_energy(local, energy, shift);
    add_moves(local);
}
