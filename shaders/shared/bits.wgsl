// Number of bits that a number has: 0 for 0, else one more than the place of its top bit.
fn length(number: u64) -> u32 {
    let high = u32(number >> 32u);
    if high != 0u {
        return 64u - countLeadingZeros(high);
    }
    return 32u - countLeadingZeros(u32(number & 0xfffffffflu));
}
