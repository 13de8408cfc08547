//! How the faces of a cluster scatter: bounds of what splits and merges change, in f64 with a margin for its error.

use glam::DVec3;

use super::{ClusterSums, Cvd, Face};
use crate::energy::functional::{Bounds, Functional as _, Sums as _};

/// Exact sums, and Σ w·d·dᵀ over the faces of a cluster, d = g − the centroid of its first face.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scatter {
    first: [i32; 3],
    sums: ClusterSums,
    /// xx, yy, zz.
    squares: DVec3,
    /// yz, zx, xy.
    products: DVec3,
}

impl Bounds for Scatter {
    type Item = Face;

    #[inline]
    fn add(&mut self, face: Face) {
        if self.sums.faces == 0 {
            self.first = face.centroid;
        }
        self.sums.add_face(face, 1);
        let d: DVec3 = std::array::from_fn(|axis| f64::from(face.centroid[axis] - self.first[axis])).into();
        let weight = f64::from(face.weight);
        self.squares += weight * d * d;
        self.products += weight * DVec3::new(d.y * d.z, d.z * d.x, d.x * d.y);
    }

    /// The norm of the scatter matrix about the mean, its error, and M for rounded proxies (`docs/arithmetic.md`).
    fn most_gain(&self) -> f64 {
        let ClusterSums { centroid, weight, faces } = self.sums;
        let sum: DVec3 = std::array::from_fn(|at| (centroid[at] - weight * i64::from(self.first[at])) as f64).into();
        let mean = sum / weight as f64;
        let squares = self.squares - sum * mean;
        let products = self.products - DVec3::new(sum.y * mean.z, sum.z * mean.x, sum.x * mean.y);
        let norm = (squares.length_squared() + 2.0 * products.length_squared()).sqrt();
        // every addition may round by 2⁻⁵³ of the sum so far
        let error = f64::from(faces + 16) * f64::EPSILON * 4.0 * self.squares.element_sum();
        norm + error + weight as f64
    }

    /// M₁M₂/(M₁+M₂)·|m₁ − m₂|², less a part for its error, and M₁ + M₂ for rounded proxies (`docs/arithmetic.md`).
    fn least_merge_cost(&self, other: &Self) -> f64 {
        let (a, b) = (&self.sums, &other.sums);
        (1.0 - 1e-9) * Cvd::merge_cost_of_means(a, b) - (a.weight + b.weight) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(faces: &[Face]) -> ClusterSums {
        let mut sums = ClusterSums::default();
        faces.iter().for_each(|&face| sums.add_face(face, 1));
        sums
    }

    #[test]
    fn no_split_gains_more_and_no_merge_costs_less() {
        let mut state = 7u64;
        let mut next = |bits: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 20) as i32 & ((1 << bits) - 1)
        };
        // how close the bounds come: the greatest parts of a bound that a split gained, and of a cost that a bound is
        let (mut closest_gain, mut closest_cost) = (0.0, 0.0);
        for round in 0..2003u32 {
            let (near, far) = (1 + round % 20, round % 27);
            let far: [i32; 3] = std::array::from_fn(|_| next(far + 1));
            let mut part = |count: usize, at: [i32; 3]| -> Vec<Face> {
                let mut point = || Face { centroid: at.map(|at| at + next(near)), weight: 1 + next(near) as u32 };
                (0..count).map(|_| point()).collect()
            };
            let faces = if round < 2000 { [1 + round % 5, 1 + round % 7] } else { [30_000, 30_000] };
            let [mut a, mut b] = [(faces[0], [0; 3]), (faces[1], far)].map(|(count, at)| part(count as usize, at));
            if round >= 2000 {
                // the first faces lie far from all others, so that all sums round in one direction
                let corner = Face { centroid: [1 - (1 << 27); 3], weight: 1 };
                [&mut a, &mut b].into_iter().for_each(|faces| faces.insert(0, corner));
            }
            let explained = |faces: &[Face]| sums(faces).fit().map_or(0, |(_, explained)| explained);
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
