//! Bounds, in f64: what they skip could not have changed anything.
//!
//! *Slacks*: by how much the distances of a face may change before it could decide otherwise. They are rounded down by
//! more than their error, so that skipping a face is exact. Distances obey the triangle inequality: they change by no
//! more than proxies drift.
//!
//! *Gains of splits* ([`most_split_gain`]), rounded up by more than their error.

use glam::{DMat3, DVec3};

use super::words::Face;

/// The slack of a face that stays in its cluster in the boundary phase: the distance to the nearest other proxy less
/// that to its own. Takes squared distances.
pub fn boundary_slack(own: u64, nearest_other: u64) -> u64 {
    // distances are below 2²⁹, so that the error of a root is far below 1
    let difference = root(nearest_other) - root(own);
    (difference - 1.0).max(0.0) as u64
}

/// The root of a squared distance, which is below 2⁶³: signed numbers are converted faster.
#[inline]
fn root(squared_distance: u64) -> f64 {
    (squared_distance.cast_signed() as f64).sqrt()
}

/// The slack of a face that has no bid in refinement.
///
/// Its gain stays negative while `√α·(d_a + x) ≤ √β·(d_b − y)`, where its own proxy drifts by x and another by y,
/// `α = M_a/(M_a − w)` and `β = M_b/(M_b + w)`. Both factors are taken at the least weights that the clusters may have
/// (`least_weight`), where they are worst. As √β ≤ 1 ≤ √α, the condition follows from
/// `√α·(x + y) ≤ √β·d_b − √α·d_a`.
#[derive(Debug, Clone, Copy)]
pub struct RefinementSlack {
    weight: f64,
    /// √α.
    root: f64,
    /// √α·d_a.
    own: f64,
    slack: f64,
}

impl RefinementSlack {
    /// For a face of some weight, and the squared distance and least weight of its own cluster.
    pub fn new(weight: u32, squared_distance: u64, least_weight: u64) -> Self {
        let weight = f64::from(weight);
        let least = least_weight.cast_signed() as f64;
        if least <= weight {
            return Self { weight, root: 1.0, own: 0.0, slack: f64::NEG_INFINITY };
        }
        let root = (least / (least - weight)).sqrt();
        Self { weight, root, own: root * self::root(squared_distance), slack: f64::INFINITY }
    }

    /// Takes another cluster into account.
    pub fn other(&mut self, squared_distance: u64, least_weight: u64) {
        let least = least_weight.cast_signed() as f64;
        let other = (squared_distance.cast_signed() as f64 * (least / (least + self.weight))).sqrt();
        self.slack = self.slack.min((other - self.own) / self.root);
    }

    /// The slack; 0 where the face may have a bid.
    pub fn get(self) -> u64 {
        (self.slack - 1.0).max(0.0) as u64
    }

    /// Whether the face surely has no bid.
    pub fn is_clear(self) -> bool {
        self.slack >= 1.0
    }
}

/// What a split of a cluster in two lowers the energy by, at most, in units of its component. Takes its faces, and its
/// proxy.
///
/// With respect to means, a split gains `M₁M₂/M·|m₁ − m₂|²`: what the means of the parts vary by, in the direction of
/// m₁ − m₂. The faces vary by no less in that direction, and in no direction by more than λ, the largest eigenvalue of
/// `T = Σ w·(g − P)(g − P)ᵀ`. Rounding adds M·|P − m|² to the energy of the cluster, ¾M at most, and lowers that of no
/// part. Of eigenvalues that are not negative, the largest is no more than the root `(Σ λᵢ⁸)^⅛ = |T⁴|^¼`, |·| being the
/// root of the sum of squares; that root is at most 1.15 λ.
pub fn most_split_gain(faces: impl Iterator<Item = Face>, proxy: [i32; 3]) -> f64 {
    let mut scatter = [DVec3::ZERO; 2];
    let mut weight = 0.0;
    for face in faces {
        // differences below 2²⁸ are exact
        let way = DVec3::from(std::array::from_fn(|axis| f64::from(face.centroid[axis]) - f64::from(proxy[axis])));
        let share = f64::from(face.weight) * way;
        scatter[0] += share * way;
        scatter[1] += DVec3::new(share.x * way.y, share.y * way.z, share.z * way.x);
        weight += f64::from(face.weight);
    }
    let [DVec3 { x: xx, y: yy, z: zz }, DVec3 { x: xy, y: yz, z: zx }] = scatter;
    let trace = xx + yy + zz;
    if trace == 0.0 {
        return 0.0;
    }
    let unit = DMat3::from_cols_array(&[xx, xy, zx, xy, yy, yz, zx, yz, zz]) * trace.recip();
    let squared = unit * unit;
    let length = (squared * squared).to_cols_array().iter().map(|part| part * part).sum::<f64>().sqrt();
    // errors of sums are below 2⁻⁵² a face, of which there are fewer than 2³²
    (trace * length.sqrt().sqrt() + weight) * (1.0 + 1e-5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::cvd::squared_distance;
    use crate::energy::{ClusterSums, Sums};

    #[test]
    fn no_split_gains_more_than_its_bound() {
        let mut state = 7u64;
        let mut next = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % below
        };
        for case in 0..200 {
            // long, flat and round ones, small and large; a few faces, all splits of them
            let extent = [1 << (case % 27), 1 << (case % 13), 1 << (case % 5)];
            let faces: Vec<Face> = (0..2 + case % 8)
                .map(|_| {
                    let centroid = extent.map(|extent| next(extent) as i32 + 1000);
                    Face { centroid, weight: next(1 << (case % 31)) as u32 + 1 }
                })
                .collect();
            let sums = |is_in: &dyn Fn(usize) -> bool| {
                let mut sums = ClusterSums::default();
                faces.iter().enumerate().filter(|&(at, _)| is_in(at)).for_each(|(_, &face)| sums.add_face(face, 1));
                sums
            };
            let (proxy, whole) = sums(&|_| true).fit().expect("faces");
            let gain = |split: u32| {
                let explained = |side| sums(&|at| split >> at & 1 == side).fit().expect("faces").1;
                explained(0) + explained(1) - whole
            };
            let best = (1..(1 << faces.len()) - 1).map(gain).max().expect("a split") as f64;
            let most = most_split_gain(faces.iter().copied(), proxy);
            assert!(best <= most, "{case}: {best} {most}");
            let energy: f64 =
                faces.iter().map(|face| f64::from(face.weight) * (squared_distance(face.centroid, proxy) as f64)).sum();
            assert!(most <= 1.001 * energy + 2.0 * sums(&|_| true).weight as f64, "{case}: {most} {energy}");
        }
    }
}
