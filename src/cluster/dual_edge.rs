//! Dual edges between clusters and the order in which they collapse (P§5.4, P§6).
//!
//! Merging two clusters raises the energy by `M₁M₂/(M₁+M₂)·|P₁−P₂|²`, which does not cancel as E₁₂ − E₁ − E₂ does. Two
//! forms of it serve, both integers: [`exact_cost`] for one merge at a time, and [`packed_cost`], 32 bits whose order is
//! the order of the values, for the parallel search of all clusters, on a gpu too.
//!
//! # Ties
//!
//! Equal costs are the rule on regular meshes. The paper takes the neighbour with the largest number, which never stalls
//! but crawls: a strip of 4,096 equal faces takes 2,059 rounds. A hash of the pair puts the edges of a plateau in a random
//! order instead, in which a constant share of them are the best at both ends (27 rounds).

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::sums::{ClusterSums, squared_distance};
use crate::device::DualEdge;

/// Which of equally cheap dual edges is the best.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ties {
    /// The one with the smallest hash of the pair
    #[default]
    Hash,
    /// The one to the neighbour with the largest number
    LargestId,
}

/// A cluster as an end of a dual edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct End {
    /// M < 2³⁴.
    pub weight: u64,
    /// P.
    pub proxy: [i32; 3],
}

impl End {
    /// M₁M₂·|P₁−P₂|²/(M₁+M₂) in units of the clusters' component, with a relative error of some 2⁻⁵⁰: to leave out edges that cost far more.
    #[inline]
    pub fn cost_about(self, other: Self) -> f64 {
        // they are signed, which is converted faster
        let [a, b] = [self.weight, other.weight].map(|weight| weight.cast_signed() as f64);
        a * b / (a + b) * squared_distance(self.proxy, other.proxy).cast_signed() as f64
    }
}

/// ⌊M₁M₂·|P₁−P₂|²/(M₁+M₂)⌋ in units of the clusters' component, below 2⁹².
pub fn exact_cost(a: End, b: End) -> u128 {
    // 2³⁴ · 2³⁴ · 2⁵⁸ fits
    let product = u128::from(a.weight) * u128::from(b.weight) * u128::from(squared_distance(a.proxy, b.proxy));
    product / u128::from(a.weight + b.weight)
}

/// The merge cost as a float of 7 bits of exponent and 25 of mantissa, in units of the finest component; 0 for cost 0.
///
/// Every step is truncated to 32 bits, so values that differ by less than some 2⁻²⁴ may trade places.
pub fn packed_cost(a: End, b: End, energy_shift: u32) -> u32 {
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

/// mantissa · 2^(exponent − 31), the mantissa's top bit set.
#[derive(Debug, Clone, Copy)]
struct Float {
    mantissa: u32,
    exponent: i32,
}

impl Float {
    /// Of a number that is not 0.
    fn of(value: u64) -> Self {
        let top = 63 - value.leading_zeros();
        let mantissa = if top > 31 { value >> (top - 31) } else { value << (31 - top) };
        Self { mantissa: mantissa as u32, exponent: top as i32 }
    }

    fn times(self, other: Self) -> Self {
        let product = u64::from(self.mantissa) * u64::from(other.mantissa);
        let carry = (product >> 63) as u32;
        Self { mantissa: (product >> (31 + carry)) as u32, exponent: self.exponent + other.exponent + carry as i32 }
    }

    fn over(self, other: Self) -> Self {
        let quotient = (u64::from(self.mantissa) << 32) / u64::from(other.mantissa);
        // between 2³¹ (exclusive) and 2³³
        let carry = (quotient >> 32) as u32;
        Self { mantissa: (quotient >> carry) as u32, exponent: self.exponent - other.exponent - 1 + carry as i32 }
    }
}

/// A 32-bit hash of an unordered pair.
pub fn hash_pair(a: u32, b: u32) -> u32 {
    let mix = |mut x: u32| {
        x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
        x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
        x ^ x >> 16
    };
    mix(mix(a.min(b)).wrapping_add(0x9e37_79b9) ^ a.max(b))
}

/// The rank of a dual edge among those of a cluster: smaller is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rank<Cost> {
    /// The merge cost.
    pub cost: Cost,
    tie: u32,
    low: u32,
    high: u32,
}

impl<Cost> Rank<Cost> {
    /// The rank of the edge to `other`, seen from `cluster`.
    pub fn new(cost: Cost, cluster: u32, other: u32, ties: Ties) -> Self {
        let tie = match ties {
            Ties::Hash => hash_pair(cluster, other),
            Ties::LargestId => !other,
        };
        Self { cost, tie, low: cluster.min(other), high: cluster.max(other) }
    }

    /// The two clusters, the smaller number first.
    pub fn ends(&self) -> (u32, u32) {
        (self.low, self.high)
    }
}

/// The mutual pairs of best dual edges, the cheapest first. `edges` are in the order of their clusters.
pub fn mutual(edges: &[DualEdge]) -> Vec<Rank<u32>> {
    let clusters = edges.last().map_or(0, |edge| edge.cluster as usize + 1);
    let mut chosen = vec![u32::MAX; clusters];
    for edge in edges {
        chosen[edge.cluster as usize] = edge.other;
    }
    let mut mutual: Vec<Rank<u32>> = edges
        .iter()
        .filter(|edge| edge.cluster < edge.other && chosen[edge.other as usize] == edge.cluster)
        .map(|edge| Rank::new(edge.cost, edge.cluster, edge.other, Ties::Hash))
        .collect();
    mutual.sort_unstable();
    mutual
}

/// Keeps the pairs that cost no more than their median, in any order.
pub fn keep_cheaper_half(mutual: &mut Vec<Rank<u32>>) {
    if !mutual.is_empty() {
        let middle = (mutual.len() - 1) / 2;
        let (_, median, _) = mutual.select_nth_unstable(middle);
        let most = median.cost;
        mutual.retain(|pair| pair.cost <= most);
    }
}

/// Two clusters that merge, the smaller number first, in the order in which the first becomes part of the second: the one with
/// more faces keeps its number, the smaller number of equal ones. `sums` are theirs.
pub fn from_into((low, high): (u32, u32), sums: &[ClusterSums; 2]) -> (u32, u32) {
    if sums[1].faces > sums[0].faces { (low, high) } else { (high, low) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_costs_are_in_the_order_of_the_exact_ones() {
        let mut state = 1u64;
        let mut next = |bits: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 20) % (1 << bits)) >> ((state >> 8) % u64::from(bits))
        };
        let mut costs: Vec<(u128, u32)> = (0..20_000)
            .map(|_| {
                let mut end =
                    || End { weight: next(34).max(1), proxy: std::array::from_fn(|_| next(28) as i32 - (1 << 27)) };
                let (a, b) = (end(), end());
                assert_eq!(packed_cost(a, b, 3), packed_cost(b, a, 3));
                (exact_cost(a, b), packed_cost(a, b, 3))
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
        assert!(packed_cost(far, other, 30) > packed_cost(far, other, 29));
        let near = End { weight: 1, proxy: [0, 0, 0] };
        let beside = End { weight: 1, proxy: [1, 0, 0] };
        assert!(packed_cost(near, beside, 0) > 0);
        assert_eq!(packed_cost(near, near, 30), 0);
    }
}
