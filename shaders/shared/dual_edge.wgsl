// Dual edges between clusters (cluster::dual_edge): the order of equally cheap ones, and the packed cost, bit for bit.

const TIES_BY_HASH: u32 = 0u;
const TIES_BY_LARGEST_ID: u32 = 1u;

fn mix(number: u32) -> u32 {
    var x = (number ^ (number >> 16u)) * 0x7feb352du;
    x = (x ^ (x >> 15u)) * 0x846ca68bu;
    return x ^ (x >> 16u);
}

// A hash of an unordered pair.
fn hash_pair(a: u32, b: u32) -> u32 {
    return mix((mix(min(a, b)) + 0x9e3779b9u) ^ max(a, b));
}

// The edge to `other` as `cluster` sees it: of equally cheap ones, the smallest is the best.
fn tie_of(cluster: u32, other: u32) -> u32 {
    if turn.ties == TIES_BY_LARGEST_ID {
        return ~other;
    }
    return hash_pair(cluster, other);
}

// mantissa·2^(exponent − 31), the mantissa's top bit set.
struct Float {
    mantissa: u32,
    exponent: i32,
}

// Of a number that is not 0.
fn float_of(value: u64) -> Float {
    let top = length(value) - 1u;
    if top > 31u {
        return Float(u32((value >> (top - 31u)) & 0xfffffffflu), i32(top));
    }
    return Float(u32((value << (31u - top)) & 0xfffffffflu), i32(top));
}

fn times(a: Float, b: Float) -> Float {
    let product = u64(a.mantissa) * u64(b.mantissa);
    let carry = u32(product >> 63u);
    return Float(u32((product >> (31u + carry)) & 0xfffffffflu), a.exponent + b.exponent + i32(carry));
}

fn over(a: Float, b: Float) -> Float {
    let quotient = (u64(a.mantissa) << 32u) / u64(b.mantissa);
    let carry = u32(quotient >> 32u);
    return Float(u32((quotient >> carry) & 0xfffffffflu), a.exponent - b.exponent - 1i + i32(carry));
}

// The packed merge cost of two clusters with faces (dual_edge::packed_cost).
fn packed_cost(cluster: u32, other: u32) -> u32 {
    let distance = distance_squared(proxies[cluster], proxies[other]);
    if distance == 0lu {
        return 0u;
    }
    let a = u64(weight_in(cluster));
    let b = u64(weight_in(other));
    let cost = times(over(times(float_of(a), float_of(b)), float_of(a + b)), float_of(distance));
    let exponent = u32(cost.exponent + 2i) + u32(proxies[cluster].w);
    return (exponent << 25u) | ((cost.mantissa << 1u) >> 7u);
}
