// Proxies and energies of clusters, in exact integers, and their sum over a dispatch.

// upper·2³² + lower, with 0 ≤ lower < 2³².
struct Wide {
    upper: i64,
    lower: i64,
}

// The shift of a signed number rounds down, so this holds for negative parts, too.
fn wide(upper: i64, lower: i64) -> Wide {
    return Wide(upper + (lower >> 32u), lower & 0xffffffffli);
}

fn plus(a: Wide, b: Wide) -> Wide {
    return wide(a.upper + b.upper, a.lower + b.lower);
}

fn minus(a: Wide, b: Wide) -> Wide {
    return wide(a.upper - b.upper, a.lower - b.lower);
}

fn is_positive(a: Wide) -> bool {
    return a.upper > 0li || (a.upper == 0li && a.lower > 0li);
}

// sum / weight rounded to nearest, halves up: ⌊(2·sum + weight) / (2·weight)⌋. |2·sum| < 2⁶² and weight < 2³⁴.
fn mean(sum: i64, weight: i64) -> i64 {
    let dividend = 2li * sum + weight;
    let divisor = 2li * weight;
    let quotient = dividend / divisor;
    return select(quotient, quotient - 1li, quotient * divisor > dividend);
}

// The proxy of a cluster that has faces.
fn proxy_of(sum: vec3<i64>, weight: i64) -> vec3<i64> {
    return vec3<i64>(mean(sum.x, weight), mean(sum.y, weight), mean(sum.z, weight));
}

// 2·P·S − M·|P|² = P·(2·S − M·P), below 2⁹². |P| ≤ 2²⁷ and |2·S − M·P| < 2⁶² an axis, so its upper 32 bits times P are
// below 2⁵⁷, its lower ones below 2⁵⁹.
fn explained_by(proxy: vec3<i64>, sum: vec3<i64>, weight: i64) -> Wide {
    let x = 2li * sum.x - weight * proxy.x;
    let y = 2li * sum.y - weight * proxy.y;
    let z = 2li * sum.z - weight * proxy.z;
    return wide(
        proxy.x * (x >> 32u) + proxy.y * (y >> 32u) + proxy.z * (z >> 32u),
        proxy.x * (x & 0xffffffffli) + proxy.y * (y & 0xffffffffli) + proxy.z * (z & 0xffffffffli),
    );
}

fn add_to_ring(limb: u32, value: u64) {
    let low = u32(value & 0xfffffffflu);
    let before = atomicAdd(&ring[turn.slot].explained[2u * limb], low);
    let high = u32(value >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&ring[turn.slot].explained[2u * limb + 1u], high);
    }
}

// Sums over the threads of the workgroup; they count 1, 2³² and 2⁶⁴, the last in two's complement.
var<workgroup> ones: array<u64, WORKGROUP>;
var<workgroup> middles: array<u64, WORKGROUP>;
var<workgroup> highs: array<u64, WORKGROUP>;

// Adds energy << shift (at most 30) of every thread to the turn's slot. All threads of the workgroup must come here.
fn report_energy(local: u32, energy: Wide, shift: u32) {
    // in steps of 32 bits
    let first = u64(energy.lower) << shift;
    let second = (u64(energy.upper & 0xffffffffli) << shift) + (first >> 32u);
    let third = ((energy.upper >> 32u) << shift) + i64(second >> 32u);
    ones[local] = first & 0xfffffffflu;
    middles[local] = second & 0xfffffffflu;
    highs[local] = u64(third);
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            ones[local] += ones[local + half];
            middles[local] += middles[local + half];
            highs[local] += highs[local + half];
        }
    }
    if local == 0u && (ones[0] | middles[0] | highs[0]) != 0lu {
        add_to_ring(0u, ones[0]);
        add_to_ring(1u, middles[0]);
        add_to_ring(2u, highs[0]);
    }
}
