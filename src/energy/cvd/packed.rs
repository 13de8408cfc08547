//! A float made of integers, which every device computes to the same bits.

/// mantissa · 2^(exponent − 31), the mantissa's top bit set.
#[derive(Debug, Clone, Copy)]
pub struct Float {
    pub mantissa: u32,
    pub exponent: i32,
}

impl Float {
    /// Of a number that is not 0.
    pub fn of(value: u64) -> Self {
        let top = 63 - value.leading_zeros();
        let mantissa = if top > 31 { value >> (top - 31) } else { value << (31 - top) };
        Self { mantissa: mantissa as u32, exponent: top as i32 }
    }

    pub fn times(self, other: Self) -> Self {
        let product = u64::from(self.mantissa) * u64::from(other.mantissa);
        let carry = (product >> 63) as u32;
        Self { mantissa: (product >> (31 + carry)) as u32, exponent: self.exponent + other.exponent + carry as i32 }
    }

    pub fn over(self, other: Self) -> Self {
        let quotient = (u64::from(self.mantissa) << 32) / u64::from(other.mantissa);
        // between 2³¹ (exclusive) and 2³³
        let carry = (quotient >> 32) as u32;
        Self { mantissa: (quotient >> carry) as u32, exponent: self.exponent - other.exponent - 1 + carry as i32 }
    }
}
