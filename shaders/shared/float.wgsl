// Positive numbers as mantissa·2^(exponent − 31), the mantissa's top bit set; every operation rounds down.

// Number of bits of a number: 0 for 0, else one more than the index of its top bit.
fn bit_length(number: u64) -> u32 {
    let high = u32(number >> 32u);
    if high != 0u {
        return 64u - countLeadingZeros(high);
    }
    return 32u - countLeadingZeros(u32(number & 0xfffffffflu));
}

struct Float {
    mantissa: u32,
    exponent: i32,
}

// Of a number that is not 0.
fn float_of(value: u64) -> Float {
    let top = bit_length(value) - 1u;
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
