// Last step of an iteration: proxies from sums, the energy of the new state, and an end to the iterations that are still
// queued when nothing moved.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> energy_shifts: array<u32>;
@group(0) @binding(2) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(3) var<storage, read_write> proxies: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(5) var<storage, read_write> next_dispatch: array<u32, 3>;

// Sums over the threads of the workgroup; they count 1, 2³² and 2⁶⁴, the last in two's complement.
var<workgroup> low: array<u64, WORKGROUP>;
var<workgroup> middle: array<u64, WORKGROUP>;
var<workgroup> high: array<u64, WORKGROUP>;

fn sum_of(cluster: u32, axis: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].sum[2u * axis]));
    let high = u64(atomicLoad(&clusters[cluster].sum[2u * axis + 1u]));
    return i64((high << 32u) | low);
}

fn weight_of(cluster: u32) -> i64 {
    let low = u64(atomicLoad(&clusters[cluster].weight[0]));
    let high = u64(atomicLoad(&clusters[cluster].weight[1]));
    return i64((high << 32u) | low);
}

// sum / weight rounded to nearest, halves up: ⌊(2·sum + weight) / (2·weight)⌋. |2·sum| < 2⁶² and weight < 2³⁴.
fn mean(sum: i64, weight: i64) -> i64 {
    let dividend = 2li * sum + weight;
    let divisor = 2li * weight;
    let quotient = dividend / divisor;
    return select(quotient, quotient - 1li, quotient * divisor > dividend);
}

// Part of P·(2·S − M·P) that one axis gives, as x·2³² + y: |P| ≤ 2²⁷ and |2·S − M·P| < 2⁶², so |x| < 2⁵⁷ and |y| < 2⁵⁹.
fn explained_by_axis(proxy: i64, sum: i64, weight: i64) -> vec2<i64> {
    let factor = 2li * sum - weight * proxy;
    return vec2<i64>(proxy * (factor >> 32u), proxy * (factor & 0xffffffffli));
}

fn add_to_ring(limb: u32, value: u64) {
    let low = u32(value & 0xfffffffflu);
    let before = atomicAdd(&ring[turn.slot].explained[2u * limb], low);
    let high = u32(value >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&ring[turn.slot].explained[2u * limb + 1u], high);
    }
}

@compute @workgroup_size(WORKGROUP)
fn fit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let cluster = thread_number(turn, group, local);
    // complete since `apply`; nothing here writes it
    let live = turn.forced != 0u || atomicLoad(&ring[turn.slot].moves) != 0u;
    if !live && cluster == 0u {
        next_dispatch = array<u32, 3>(0u, 0u, 0u);
    }

    low[local] = 0lu;
    middle[local] = 0lu;
    high[local] = 0lu;
    if live && cluster < turn.clusters {
        let weight = weight_of(cluster);
        if weight != 0li {
            let x = sum_of(cluster, 0u);
            let y = sum_of(cluster, 1u);
            let z = sum_of(cluster, 2u);
            let px = mean(x, weight);
            let py = mean(y, weight);
            let pz = mean(z, weight);
            proxies[cluster] = vec4<i32>(i32(px), i32(py), i32(pz), 0i);

            let parts = explained_by_axis(px, x, weight)
                + explained_by_axis(py, y, weight)
                + explained_by_axis(pz, z, weight);
            // upper·2³² + lower with 0 ≤ lower < 2³²; the shift of a signed number rounds down
            let upper = parts.x + (parts.y >> 32u);
            let lower = parts.y & 0xffffffffli;
            // times 2^shift, shift ≤ 30, in steps of 32 bits
            let shift = energy_shifts[cluster];
            let first = u64(lower) << shift;
            let second = (u64(upper & 0xffffffffli) << shift) + (first >> 32u);
            let third = ((upper >> 32u) << shift) + i64(second >> 32u);
            low[local] = first & 0xfffffffflu;
            middle[local] = second & 0xfffffffflu;
            high[local] = u64(third);
        }
        atomicStore(&clusters[cluster].staying, atomicLoad(&clusters[cluster].count));
        atomicStore(&clusters[cluster].first_leaver, FREE);
    }

    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            low[local] += low[local + half];
            middle[local] += middle[local + half];
            high[local] += high[local + half];
        }
    }
    if live && local == 0u {
        add_to_ring(0u, low[0]);
        add_to_ring(1u, middle[0]);
        add_to_ring(2u, high[0]);
    }
}
