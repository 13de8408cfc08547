//! How the faces of a cluster scatter: bounds of what splits and merges change, in f64 with a margin for their error.

use super::{ClusterSums, Cvd};
use crate::energy::functional::{Bounds, Item, Sums as _};

/// Exact sums, and Σ w·d·dᵀ over the faces of a cluster, d = g − the centroid of its first face.
#[derive(Debug, Clone)]
pub struct Scatter<const D: usize> {
    first: [i32; D],
    sums: ClusterSums<D>,
    squares: [f64; D],
    /// Of different axes, the first [`PAIRS`](Self::PAIRS).
    products: [f64; 28],
}

impl<const D: usize> Default for Scatter<D> {
    fn default() -> Self {
        Self { first: [0; D], sums: ClusterSums::default(), squares: [0.0; D], products: [0.0; 28] }
    }
}

impl<const D: usize> Scatter<D> {
    /// Pairs of axes. None above 8 axes: the trace then bounds the norm.
    const PAIRS: usize = if D > 8 { 0 } else { D * (D - 1) / 2 };

    /// What rounded proxies change a gain or a cost by, at most, a unit of weight: d/4.
    const ROUNDING: f64 = if D > 4 { D as f64 / 4.0 } else { 1.0 };
}

/// The pairs of axes, in the order of their products.
fn pairs<const D: usize>() -> impl Iterator<Item = (usize, usize)> {
    (0..D).flat_map(|a| (a + 1..D).map(move |b| (a, b)))
}

impl<const D: usize> Bounds<Cvd<D>> for Scatter<D> {
    #[inline]
    fn add(&mut self, face: Item<[i32; D]>) {
        if self.sums.faces == 0 {
            self.first = face.point;
        }
        self.sums.add_face(face, 1);
        let d: [f64; D] = std::array::from_fn(|axis| f64::from(face.point[axis] - self.first[axis]));
        let weight = f64::from(face.weight);
        for axis in 0..D {
            self.squares[axis] += weight * d[axis] * d[axis];
        }
        for (product, (a, b)) in self.products[..Self::PAIRS].iter_mut().zip(pairs::<D>()) {
            *product += weight * (d[a] * d[b]);
        }
    }

    /// The norm of the scatter matrix about the mean, its error, and what rounding changes (`docs/arithmetic.md`).
    fn most_gain(&self) -> f64 {
        let ClusterSums { centroid, weight, faces } = self.sums;
        let sum: [f64; D] = std::array::from_fn(|at| (centroid[at] - weight * i64::from(self.first[at])) as f64);
        let mean = sum.map(|sum| sum / weight as f64);
        let squares: [f64; D] = std::array::from_fn(|axis| self.squares[axis] - sum[axis] * mean[axis]);
        let norm = if Self::PAIRS == 0 {
            squares.iter().sum()
        } else {
            let products = self.products[..Self::PAIRS]
                .iter()
                .zip(pairs::<D>())
                .map(|(product, (a, b))| product - sum[a] * mean[b]);
            let of_squares: f64 = squares.iter().map(|x| x * x).sum();
            (of_squares + 2.0 * products.map(|x| x * x).sum::<f64>()).sqrt()
        };
        // every addition may round by 2⁻⁵³ of the sum so far
        let error = f64::from(faces + 16) * f64::EPSILON * 4.0 * self.squares.iter().sum::<f64>();
        norm + error + Self::ROUNDING * weight as f64
    }

    /// M₁M₂/(M₁+M₂)·|m₁ − m₂|², less a part for its error, and (M₁ + M₂)·d/4 for rounded proxies.
    fn least_merge_cost(&self, other: &Self) -> f64 {
        let [(a, m), (b, n)] = [self, other].map(|of| (of.sums.weight as f64, of.sums.mean()));
        let square: f64 = (0..D).map(|axis| (m[axis] - n[axis]) * (m[axis] - n[axis])).sum();
        (1.0 - 1e-9) * (a * b / (a + b) * square) - Self::ROUNDING * (a + b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    type Face = Item<[i32; 3]>;

    fn sums(faces: &[Face]) -> ClusterSums<3> {
        let mut sums = ClusterSums::default();
        faces.iter().for_each(|&face| sums.add_face(face, 1));
        sums
    }

    #[test]
    fn no_split_gains_more_and_no_merge_costs_less() {
        let mut states = random(7);
        let mut next = |bits: u32| (states() >> 20) as i32 & ((1 << bits) - 1);
        // how close the bounds come: the greatest parts of a bound that a split gained, and of a cost that a bound is
        let (mut closest_gain, mut closest_cost) = (0.0, 0.0);
        for round in 0..2003u32 {
            let (near, far) = (1 + round % 20, round % 27);
            let far: [i32; 3] = std::array::from_fn(|_| next(far + 1));
            let mut part = |count: usize, at: [i32; 3]| -> Vec<Face> {
                let mut point = || Face { point: at.map(|at| at + next(near)), weight: 1 + next(near) as u32 };
                (0..count).map(|_| point()).collect()
            };
            let faces = if round < 2000 { [1 + round % 5, 1 + round % 7] } else { [30_000, 30_000] };
            let [mut a, mut b] = [(faces[0], [0; 3]), (faces[1], far)].map(|(count, at)| part(count as usize, at));
            if round >= 2000 {
                // the first faces lie far from all others, so that all sums round in one direction
                let corner = Face { point: [1 - (1 << 27); 3], weight: 1 };
                [&mut a, &mut b].into_iter().for_each(|faces| faces.insert(0, corner));
            }
            let explained = |faces: &[Face]| sums(faces).explained();
            let whole = [&a[..], &b[..]].concat();
            let gain = (explained(&a) + explained(&b) - explained(&whole)) as f64;
            let [a, b, whole] = [a, b, whole].map(|faces| {
                let mut scatter = Scatter::default();
                faces.into_iter().for_each(|face| scatter.add(face));
                scatter
            });
            assert!(gain <= whole.most_gain(), "{gain} {whole:?}");
            assert!(gain >= a.least_merge_cost(&b), "{gain} {a:?} {b:?}");
            closest_gain = f64::max(closest_gain, gain / whole.most_gain());
            closest_cost = f64::max(closest_cost, a.least_merge_cost(&b) / gain);
        }
        assert!(closest_gain > 0.99 && closest_cost > 0.99, "{closest_gain} {closest_cost}");
    }
}
