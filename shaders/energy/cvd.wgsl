//! uses: wide, float
// The CVD energy (P§6): everything that depends on what a face costs in a cluster. Another energy is a file with the
// same names. `energy::cvd` is the same in Rust; `energy::cvd::words` has `Face` and `Proxy`.
// Bit widths: |coordinate| < 2²⁷, of more than 4 axes < 2²⁶; Σ weight < 2³⁴, |Σ weight·point| < 2⁶¹ an axis.
// What each axis or sum has once is written out: `device::gpu::axes`.

// Sums over faces, from which a cluster's proxy and energy follow: Σ weight·point on each axis, then Σ weight.
alias Sums = array<i64, SUMS>;

const NO_SUMS = Sums();

// Index of Σ weight.
const WEIGHT: u32 = AXES;

fn sums_of(face: Face) -> Sums {
    // by way of u64, because naga extends the sign when it converts u32 to i64
    let weight = i64(u64(face.weight));
    return Sums(@list(i64(face.point[$]) * weight), weight);
}

fn sums_plus(a: Sums, b: Sums) -> Sums {
    return Sums(@list(a[#] + b[#]));
}

fn sums_minus(a: Sums, b: Sums) -> Sums {
    return Sums(@list(a[#] - b[#]));
}

fn square(number: i32) -> u64 {
    let magnitude = u64(u32(abs(number)));
    return magnitude * magnitude;
}

// Squared distance of two lattice points, below 2⁵⁸.
fn distance_squared(a: Point, b: Point) -> u64 {
    return @sum(square(a[$] - b[$]));
}

// What a unit of the face's weight costs in a cluster with this proxy.
fn cost(face: Face, proxy: Proxy) -> u64 {
    return distance_squared(face.point, proxy.position);
}

// Whether faces cost the same with either proxy.
fn is_same(a: Proxy, b: Proxy) -> bool {
    return distance_squared(a.position, b.position) == 0lu;
}

// sum / weight rounded to nearest, halves up: ⌊(2·sum + weight) / (2·weight)⌋.
fn mean(sum: i64, weight: i64) -> i32 {
    let dividend = 2li * sum + weight;
    let divisor = 2li * weight;
    let quotient = dividend / divisor;
    return i32(select(quotient, quotient - 1li, quotient * divisor > dividend));
}

// The proxy of a cluster with faces.
fn fit(sums: Sums, energy_shift: u32) -> Proxy {
    let weight = sums[WEIGHT];
    return Proxy(Point(@list(mean(sums[$], weight))), energy_shift);
}

// The explained energy 2·P·S − M·|P|² = P·(2·S − M·P), below 2⁹². |P| ≤ 2²⁷ and |2·S − M·P| < 2⁶² an axis, so the
// product of P with the upper 32 bits is below 2⁵⁷ an axis, with the lower ones below 2⁵⁹; of more than 4 axes, where
// |P| ≤ 2²⁶, half of that.
fn explained(proxy: Proxy, sums: Sums) -> Wide {
    @each(let p_$ = i64(proxy.position[$]);)
    @each(let factor_$ = 2li * sums[$] - sums[WEIGHT] * p_$;)
    return wide(@sum(p_$ * (factor_$ >> 32u)), @sum(p_$ * (factor_$ & 0xffffffffli)));
}

// distance·weight / rest; weight / rest, below 1, as a fraction of 32 bits.
fn scaled(distance: u64, weight: u64, rest: u64) -> u64 {
    let fraction = min((weight << 32u) / rest, 0xfffffffflu);
    return (distance >> 32u) * fraction + (((distance & 0xfffffffflu) * fraction) >> 32u);
}

// What a cluster gains, by weight, when a face leaves it, its proxy following.
fn gain_of_leaving(face: Face, proxy: Proxy, cluster_weight: i64) -> i64 {
    let weight = u64(face.weight);
    let distance = cost(face, proxy);
    return i64(distance + scaled(distance, weight, u64(cluster_weight) - weight));
}

// What it costs a cluster, by weight, when a face enters it, its proxy following.
fn cost_of_entering(face: Face, proxy: Proxy, cluster_weight: i64) -> i64 {
    let weight = u64(face.weight);
    let distance = cost(face, proxy);
    return i64(distance - scaled(distance, weight, u64(cluster_weight) + weight));
}

// gain·weight of the face as a float of 7 bits of exponent and 25 of mantissa, whose order is that of u32; at least 1.
fn packed_bid(gain: i64, face: Face) -> u32 {
    let drop = max(bit_length(u64(gain)), 32u) - 32u;
    let product = float_of((u64(gain) >> drop) * u64(face.weight));
    return (((u32(product.exponent) + drop) << 25u) | ((product.mantissa << 1u) >> 7u)) + 1u;
}

// The cost of merging two clusters with faces, (M₁·M₂/(M₁ + M₂)·|P₁ − P₂|²) << shift, in a float of 7 bits of exponent
// and 25 of mantissa, whose order is that of u32.
fn packed_merge_cost(a: Proxy, a_weight: i64, b: Proxy, b_weight: i64) -> u32 {
    let distance = distance_squared(a.position, b.position);
    if distance == 0lu {
        return 0u;
    }
    let product = times(float_of(u64(a_weight)), float_of(u64(b_weight)));
    let cost = times(over(product, float_of(u64(a_weight + b_weight))), float_of(distance));
    let exponent = u32(cost.exponent + 2i) + a.energy_shift;
    return (exponent << 25u) | ((cost.mantissa << 1u) >> 7u);
}

// Bits of a digit of the long division: a remainder below the divisor's 2³⁵ and a digit fit into 64 bits.
const DIGIT: u32 = 29u;
const DIGIT_MASK: u64 = 0x1ffffffflu;

// The same cost rounded down to an integer, high and low word; weights < 2³⁴, distance < 2⁵⁸, shift ≤ 30.
fn exact_merge_cost(proxy_a: Proxy, a_weight: i64, proxy_b: Proxy, b_weight: i64) -> vec2<u64> {
    let distance = distance_squared(proxy_a.position, proxy_b.position);
    let shift = proxy_a.energy_shift;
    let a = u64(a_weight);
    let b = u64(b_weight);
    let a_0 = a & DIGIT_MASK;
    let a_1 = a >> DIGIT;
    let b_0 = b & DIGIT_MASK;
    let b_1 = b >> DIGIT;
    // a·b < 2⁶⁸ in digits, the top one below 2¹⁰
    let low = a_0 * b_0;
    let middle = a_0 * b_1 + a_1 * b_0 + (low >> DIGIT);
    let weight_0 = low & DIGIT_MASK;
    let weight_1 = middle & DIGIT_MASK;
    let weight_2 = a_1 * b_1 + (middle >> DIGIT);
    // a·b·distance < 2¹²⁶ in digits; no sum of two products and a carry reaches 2⁶⁰
    let distance_0 = distance & DIGIT_MASK;
    let distance_1 = distance >> DIGIT;
    let first = weight_0 * distance_0;
    let second = weight_0 * distance_1 + weight_1 * distance_0 + (first >> DIGIT);
    let third = weight_1 * distance_1 + weight_2 * distance_0 + (second >> DIGIT);
    let fourth = weight_2 * distance_1 + (third >> DIGIT);
    // the quotient is below 2⁹², so its fourth digit holds all of its upper bits
    let divisor = a + b;
    let digit_3 = fourth / divisor;
    var rest = ((fourth % divisor) << DIGIT) | (third & DIGIT_MASK);
    let digit_2 = rest / divisor;
    rest = ((rest % divisor) << DIGIT) | (second & DIGIT_MASK);
    let digit_1 = rest / divisor;
    rest = ((rest % divisor) << DIGIT) | (first & DIGIT_MASK);
    let digit_0 = rest / divisor;
    let high_word = (digit_3 << 23u) | (digit_2 >> 6u);
    let low_word = (digit_2 << 58u) | (digit_1 << DIGIT) | digit_0;
    // the bits that move into the high word, in two shifts, as a shift by 64 is none
    let carried = (low_word >> 34u) >> (30u - shift);
    return vec2<u64>((high_word << shift) | carried, low_word << shift);
}
