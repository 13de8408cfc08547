//! uses: wide
// Sums an energy over all threads of a dispatch into `stats`, as sums of weight 1, 2³² and 2⁶⁴, the last in two's
// complement.

fn add_to_stats(limb: u32, value: u64) {
    let low = u32(value & 0xfffffffflu);
    let before = atomicAdd(&stats[iteration.slot].explained[2u * limb], low);
    let high = u32(value >> 32u) + select(0u, 1u, before + low < before);
    if high != 0u {
        atomicAdd(&stats[iteration.slot].explained[2u * limb + 1u], high);
    }
}

var<private> total: vec3<u64>;
var<workgroup> totals: array<vec3<u64>, WORKGROUP>;

// Adds energy << shift (at most 30) to what this thread has.
fn add_energy(energy: Wide, shift: u32) {
    let first = u64(energy.lower) << shift;
    let second = (u64(energy.upper & 0xffffffffli) << shift) + (first >> 32u);
    let third = ((energy.upper >> 32u) << shift) + i64(second >> 32u);
    total += vec3<u64>(first & 0xfffffffflu, second & 0xfffffffflu, u64(third));
}

// Adds what the threads of the workgroup have. Every thread of the workgroup must call this.
fn write_energy(local: u32) {
    totals[local] = total;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            totals[local] += totals[local + half];
        }
    }
    if local == 0u && any(totals[0] != vec3<u64>()) {
        add_to_stats(0u, totals[0].x);
        add_to_stats(1u, totals[0].y);
        add_to_stats(2u, totals[0].z);
    }
}
