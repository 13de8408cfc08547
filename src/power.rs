//! Powers of two as factors.

/// 2^exponent as two factors, which are normal numbers where it is not.
pub(crate) fn factors(exponent: i32) -> [f64; 2] {
    let half = exponent / 2;
    [libm::ldexp(1.0, half), libm::ldexp(1.0, exponent - half)]
}
