//! The energy of centroidal Voronoi diagrams (P§6): the area-weighted squared distance of centroids to the proxy of
//! their cluster.
//!
//! Points have D coordinates; those of data with fewer are padded with zeros, which change no sum.
//!
//! Σ over clusters of `(2·P·S − M·|P|²) << energy_shift` is what the proxies explain of the constant Σ w·|g|².

mod bound;
mod packed;
mod scatter;
pub mod wide;
pub mod words;

use self::packed::Float;
use super::functional::{End, Functional, Item, Side, Sums};

pub use self::bound::{RefinementSlack, boundary_slack};

/// The energy of centroidal Voronoi diagrams of points with D coordinates.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cvd<const D: usize>;

impl<const D: usize> Functional for Cvd<D> {
    const NO_PROXY: [i32; D] = [0; D];

    /// A cost has a relative error below (D + 9)·2⁻²⁴: each conversion and operation adds 2⁻²⁴, and only integers are
    /// subtracted. Packed costs resolve 1 + 2⁻²⁴.
    const ROUGH_MARGIN: f32 = 1.0 + (D + 16) as f32 / (1 << 22) as f32;

    /// g, or P.
    type Point = [i32; D];
    type Sums = ClusterSums<D>;
    type WideSums = wide::Sums<D>;
    type SplitBounds = scatter::Scatter<D>;
    type Position = [f64; D];

    /// |g − P|².
    #[inline]
    fn cost(point: [i32; D], proxy: [i32; D]) -> u64 {
        squared_distance(point, proxy)
    }

    /// w·|g|².
    #[inline]
    fn constant(Item { point, weight }: Item<[i32; D]>) -> i128 {
        let square: i64 = point.iter().map(|&g| i64::from(g) * i64::from(g)).sum();
        i128::from(weight) * i128::from(square)
    }

    /// ⌊M₁M₂·|P₁−P₂|²/(M₁+M₂)⌋.
    fn merge_cost(a: End<[i32; D]>, b: End<[i32; D]>) -> u128 {
        // 2³⁴ · 2³⁴ · 2⁵⁸ fits
        let product = u128::from(a.weight) * u128::from(b.weight) * u128::from(squared_distance(a.proxy, b.proxy));
        product / u128::from(a.weight + b.weight)
    }

    /// A float of 7 bits of exponent and 25 of mantissa; 0 for cost 0.
    ///
    /// Every step is truncated to 32 bits, so values that differ by less than some 2⁻²⁴ may trade places.
    fn packed_merge_cost(a: End<[i32; D]>, b: End<[i32; D]>, energy_shift: u32) -> u32 {
        let distance = squared_distance(a.proxy, b.proxy);
        if distance == 0 {
            return 0;
        }
        let harmonic = Float::of(a.weight).times(Float::of(b.weight)).over(Float::of(a.weight + b.weight));
        let cost = harmonic.times(Float::of(distance));
        // cost ≥ 2⁻¹, and the largest exponent is below 92 + 30 + 2
        let exponent = (cost.exponent + 2) as u32 + energy_shift;
        exponent << 25 | (cost.mantissa << 1 >> 7)
    }

    #[inline]
    fn rough_merge_cost(a: End<[i32; D], f32>, b: End<[i32; D], f32>) -> f32 {
        let mut square = 0.0;
        for axis in 0..D {
            let difference = (a.proxy[axis] - b.proxy[axis]) as f32;
            square += difference * difference;
        }
        a.weight * b.weight / (a.weight + b.weight) * square
    }

    /// In units of squared lattice length. M/(M − w) = 1 + w/(M − w), and M/(M + w) = 1 − w/(M + w): the second terms
    /// are 32-bit fractions. Where the face is heavier than the rest of its cluster, the first is taken as 1.
    #[inline]
    fn gain(weight: u32, from: Side, to: Side) -> i64 {
        let w = u64::from(weight);
        let scaled = |distance: u64, rest: u64| {
            let fraction = ((w << 32) / rest).min(u64::from(u32::MAX));
            // (distance · fraction) / 2³², the upper and the lower half of the distance apart
            (distance >> 32) * fraction + (((distance & 0xffff_ffff) * fraction) >> 32)
        };
        let leave = from.cost + scaled(from.cost, from.weight - w);
        let enter = to.cost - scaled(to.cost, to.weight + w);
        leave as i64 - enter as i64
    }

    /// A float of 7 bits of exponent and 25 of mantissa.
    #[inline]
    fn bid(gain: i64, weight: u32) -> u32 {
        let gain = gain as u64;
        // 32 bits of the gain are enough to rank it, and their product with the weight fits
        let drop = (32 - gain.leading_zeros() as i32).max(0) as u32;
        let product = (gain >> drop) * u64::from(weight);
        let top = 63 - product.leading_zeros();
        let mantissa = if top > 25 { product >> (top - 25) } else { product << (25 - top) };
        (((top + drop) << 25) | (mantissa as u32 & ((1 << 25) - 1))) + 1
    }

    #[inline]
    fn drift(from: [i32; D], to: [i32; D]) -> u64 {
        // the error of the root is far below 1
        (squared_distance(to, from) as f64).sqrt() as u64
    }

    /// area·|g − P|², P the area-weighted mean of the cluster's centroids (P§6, Eq. 4).
    fn source_proxies(faces: impl Iterator<Item = ([f64; D], f64, u32)>, clusters: usize) -> Vec<[f64; D]> {
        let mut sums = vec![([0.0; D], 0.0); clusters];
        for (centroid, area, label) in faces {
            let (sum, total) = &mut sums[label as usize];
            for axis in 0..D {
                sum[axis] += area * centroid[axis];
            }
            *total += area;
        }
        let mean = |(sum, area): ([f64; D], f64)| sum.map(|sum| sum / if area > 0.0 { area } else { 1.0 });
        sums.into_iter().map(mean).collect()
    }

    fn source_term(centroid: [f64; D], area: f64, proxy: [f64; D]) -> f64 {
        let square = |axis: usize| (centroid[axis] - proxy[axis]) * (centroid[axis] - proxy[axis]);
        area * (1..D).fold(square(0), |sum, axis| sum + square(axis))
    }
}

/// The sums over the faces of a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClusterSums<const D: usize> {
    /// S = Σ w·g, |S| < 2⁶¹ an axis.
    pub centroid: [i64; D],
    /// M = Σ w < 2³⁴.
    pub weight: i64,
    /// Number of faces.
    pub faces: u32,
}

impl<const D: usize> Default for ClusterSums<D> {
    fn default() -> Self {
        Self { centroid: [0; D], weight: 0, faces: 0 }
    }
}

impl<const D: usize> Sums<Cvd<D>> for ClusterSums<D> {
    #[inline]
    fn add_face(&mut self, face: Item<[i32; D]>, sign: i64) {
        let weight = i64::from(face.weight);
        let centroid = face.point.map(|g| weight * i64::from(g));
        self.add(&Self { centroid, weight, faces: 1 }, sign);
    }

    #[inline]
    fn add(&mut self, other: &Self, sign: i64) {
        for axis in 0..D {
            self.centroid[axis] += sign * other.centroid[axis];
        }
        self.weight += sign * other.weight;
        self.faces = self.faces.wrapping_add_signed(sign as i32 * other.faces as i32);
    }

    #[inline]
    fn faces(&self) -> u32 {
        self.faces
    }

    #[inline]
    fn weight(&self) -> u64 {
        self.weight as u64
    }

    /// The proxy P, the lattice point nearest to S/M (per axis, halves up). None without faces.
    #[inline]
    fn proxy(&self) -> Option<[i32; D]> {
        let nearest = |s: i64| (2 * s + self.weight).div_euclid(2 * self.weight) as i32;
        (self.faces > 0).then(|| self.centroid.map(nearest))
    }

    /// The proxy P and 2·P·S − M·|P|², what it explains of the energy; |explained| < 2⁹¹. None without faces.
    #[inline]
    fn fit(&self) -> Option<([i32; D], i128)> {
        let proxy = self.proxy()?;
        let mut along = 0;
        let mut square = 0;
        for axis in 0..D {
            along += i128::from(proxy[axis]) * i128::from(self.centroid[axis]);
            square += i64::from(proxy[axis]) * i64::from(proxy[axis]);
        }
        Some((proxy, 2 * along - i128::from(self.weight) * i128::from(square)))
    }

    fn mean(&self) -> [f64; D] {
        self.centroid.map(|s| s as f64 / self.weight as f64)
    }
}

/// Squared distance between two lattice points, below 2⁵⁸.
#[inline]
pub fn squared_distance<const D: usize>(a: [i32; D], b: [i32; D]) -> u64 {
    let mut sum = 0;
    for axis in 0..D {
        let difference = i64::from(a[axis]) - i64::from(b[axis]);
        sum += (difference * difference) as u64;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    type Energy = Cvd<3>;

    #[test]
    fn packed_costs_are_in_the_order_of_the_exact_ones() {
        let mut states = random(1);
        let mut next = |bits: u32| {
            let state = states();
            ((state >> 20) % (1 << bits)) >> ((state >> 8) % u64::from(bits))
        };
        let mut costs: Vec<(u128, u32)> = (0..20_000)
            .map(|_| {
                let mut end =
                    || End { weight: next(34).max(1), proxy: std::array::from_fn(|_| next(28) as i32 - (1 << 27)) };
                let (a, b) = (end(), end());
                assert_eq!(Energy::packed_merge_cost(a, b, 3), Energy::packed_merge_cost(b, a, 3));
                (Energy::merge_cost(a, b), Energy::packed_merge_cost(a, b, 3))
            })
            .collect();
        costs.sort_unstable();
        for pair in costs.windows(2) {
            let apart = pair[1].0 - pair[0].0 > (pair[0].0 >> 22) + 1;
            assert!(!apart || pair[0].1 < pair[1].1, "{pair:?}");
        }
    }

    #[test]
    fn the_largest_and_smallest_costs_fit() {
        let far = End { weight: (1 << 34) - 1, proxy: [(1 << 27) - 1; 3] };
        let other = End { weight: (1 << 34) - 1, proxy: [-(1 << 27) + 1; 3] };
        assert!(Energy::packed_merge_cost(far, other, 30) > Energy::packed_merge_cost(far, other, 29));
        let near = End { weight: 1, proxy: [0, 0, 0] };
        let beside = End { weight: 1, proxy: [1, 0, 0] };
        assert!(Energy::packed_merge_cost(near, beside, 0) > 0);
        assert_eq!(Energy::packed_merge_cost(near, near, 30), 0);
    }

    #[test]
    fn gain_is_the_difference_of_exact_energies() {
        // one axis: cluster a has faces at 0, 0, 10, cluster b at 12, 14; all of weight 5; the face at 10 goes to b
        let from = Side { cost: 44_444_444, weight: 15 }; // (10 − 10/3)² in millionths
        let to = Side { cost: 9_000_000, weight: 10 };
        // energies with means: a 200/3·5 → 0; b 2·5 → (4 + 0 + 4)·5
        let exact = (200.0 / 3.0 + 2.0 - 8.0) * 1e6;
        assert!((Energy::gain(5, from, to) as f64 - exact).abs() < 2.0, "{} {exact}", Energy::gain(5, from, to));
    }

    #[test]
    fn bids_are_in_the_order_of_their_values() {
        let mut values = Vec::new();
        for gain_bits in [1, 5, 20, 31, 32, 33, 45, 59] {
            for gain in [(1i64 << gain_bits) - 1, 1 << gain_bits] {
                for weight in [1u32, 2, 3, 1000, 1 << 20, u32::MAX] {
                    values.push((i128::from(gain) * i128::from(weight), Energy::bid(gain, weight)));
                }
            }
        }
        values.sort_unstable();
        for pair in values.windows(2) {
            // 25 bits of mantissa: values that differ by less than 2⁻²⁴ may be taken for equal
            let apart = pair[1].0 - pair[0].0 > pair[0].0 >> 24;
            assert!(!apart || pair[0].1 < pair[1].1, "{pair:?}");
        }
        assert!(values.iter().all(|&(_, bid)| bid > 0));
    }
}
