//! How the faces of a cluster scatter: bounds of what splits and merges change, in f64 with a margin for its error.

use glam::DVec3;

use super::Face;
use crate::energy::functional::Bounds;

/// Relative margin, above all errors of the arithmetic here.
const MARGIN: f64 = 1e-9;

/// Σ w, Σ w·d and Σ w·d·dᵀ over the faces of a cluster, d = g − the centroid of its first face.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scatter {
    first: DVec3,
    weight: f64,
    sum: DVec3,
    /// xx, yy, zz.
    squares: DVec3,
    /// yz, zx, xy.
    products: DVec3,
}

impl Scatter {
    /// From the first face to the mean.
    fn to_mean(self) -> DVec3 {
        self.sum / self.weight
    }
}

impl Bounds for Scatter {
    type Item = Face;

    #[inline]
    fn add(&mut self, face: Face) {
        let (point, weight) = (DVec3::from(face.centroid.map(f64::from)), f64::from(face.weight));
        if self.weight == 0.0 {
            self.first = point;
        }
        let d = point - self.first;
        self.weight += weight;
        self.sum += weight * d;
        self.squares += weight * d * d;
        self.products += weight * DVec3::new(d.y * d.z, d.z * d.x, d.x * d.y);
    }

    /// The norm of the scatter matrix about the mean, and M for rounded proxies (`docs/arithmetic.md`).
    fn most_gain(&self) -> f64 {
        let (mean, m) = (self.to_mean(), self.sum);
        let squares = self.squares - m * mean;
        let products = self.products - DVec3::new(m.y * mean.z, m.z * mean.x, m.x * mean.y);
        let norm = (squares.length_squared() + 2.0 * products.length_squared()).sqrt();
        norm + MARGIN * self.squares.element_sum() + self.weight
    }

    /// M₁M₂/(M₁+M₂)·|m₁ − m₂|², without M₁ + M₂ for rounded proxies.
    fn least_merge_cost(&self, other: &Self) -> f64 {
        let apart = (self.first - other.first) + (self.to_mean() - other.to_mean());
        let weight = self.weight + other.weight;
        (1.0 - MARGIN) * self.weight * other.weight / weight * apart.length_squared() - weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::Sums;
    use crate::energy::cvd::ClusterSums;

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
        for round in 0..2000 {
            let (near, far) = (1 + round % 20, round % 27);
            let far: [i32; 3] = std::array::from_fn(|_| next(far + 1));
            let mut part = |count: usize, at: [i32; 3]| -> Vec<Face> {
                let mut point = || Face { centroid: at.map(|at| at + next(near)), weight: 1 + next(near) as u32 };
                (0..count).map(|_| point()).collect()
            };
            let (a, b) = (part(1 + round as usize % 5, [0; 3]), part(1 + round as usize % 7, far));
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
            assert!(a.least_merge_cost(&b) < whole.most_gain());
        }
    }
}
