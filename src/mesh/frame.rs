//! A frame for integers: positions centred on their bounding box and scaled by a power of two.

use glam::DVec3;

use crate::power::factors;

/// Coordinate = (source coordinate − centre) × 2^exponent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    pub centre: DVec3,
    /// Power of two between lengths in the source and here.
    pub exponent: i32,
    /// 2^exponent as [`factors`].
    pub factors: [f64; 2],
    /// Length of the diagonal of the bounding box, in this frame.
    pub diagonal: f64,
}

impl Frame {
    /// The frame of some positions: half of the longest side of their bounding box is below 2^`bits`, and not by half.
    pub fn of(positions: impl Iterator<Item = [f64; 3]>, bits: i32) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for position in positions {
            (low, high) = (low.min(position.into()), high.max(position.into()));
        }
        // halves first: the sum and the difference of two finite numbers may not be finite
        let centre = low / 2.0 + high / 2.0;
        let half = high / 2.0 - low / 2.0;
        let reach = half.max_element();
        let exponent = if reach > 0.0 { bits - libm::frexp(reach).1 } else { 0 };
        let factors = factors(exponent);
        let diagonal = if reach > 0.0 { (half * factors[0] * factors[1]).length() * 2.0 } else { 0.0 };
        Self { centre, exponent, factors, diagonal }
    }

    /// A position of the source in this frame.
    #[inline]
    pub fn position(&self, source: [f64; 3]) -> DVec3 {
        (DVec3::from(source) - self.centre) * self.factors[0] * self.factors[1]
    }

    /// A position of this frame in the source.
    pub fn source_position(&self, position: DVec3) -> DVec3 {
        position.map(|x| libm::ldexp(x, -self.exponent)) + self.centre
    }
}
