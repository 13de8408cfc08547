// upper·2³² + lower, with 0 ≤ lower < 2³²: a signed number of 96 bits.
struct Wide {
    upper: i64,
    lower: i64,
}

// The right shift of a signed number rounds down, so this also holds for a negative lower part.
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
