//! The sums in 128 bits, as their definition reads. The plain device computes with them; the narrow forms are compared
//! with it.

use super::{ClusterSums, Cvd};
use crate::energy::functional::{End, Item, WideSums};

/// Sums over the faces of a cluster.
#[derive(Debug, Clone)]
pub struct Sums<const D: usize> {
    /// S = Σ w·g.
    s: [i128; D],
    /// M = Σ w.
    m: i128,
    faces: u32,
}

impl<const D: usize> Default for Sums<D> {
    fn default() -> Self {
        Self { s: [0; D], m: 0, faces: 0 }
    }
}

impl<const D: usize> Sums<D> {
    /// P: S / M rounded to the nearest lattice point, halves up. The cluster has faces.
    pub fn proxy(&self) -> [i128; D] {
        self.s.map(|s| (2 * s + self.m).div_euclid(2 * self.m))
    }
}

impl<const D: usize> WideSums<Cvd<D>> for Sums<D> {
    fn add_face(&mut self, face: Item<[i32; D]>) {
        let weight = i128::from(face.weight);
        for axis in 0..D {
            self.s[axis] += weight * i128::from(face.point[axis]);
        }
        self.m += weight;
        self.faces += 1;
    }

    fn faces(&self) -> u32 {
        self.faces
    }

    fn weight(&self) -> u64 {
        self.m as u64
    }

    /// |g − P|².
    fn cost(&self, face: Item<[i32; D]>) -> i128 {
        let proxy = self.proxy();
        (0..D).map(|axis| (i128::from(face.point[axis]) - proxy[axis]).pow(2)).sum()
    }

    /// 2·P·S − M·|P|².
    fn explained(&self) -> i128 {
        let proxy = self.proxy();
        let along: i128 = (0..D).map(|axis| 2 * proxy[axis] * self.s[axis]).sum();
        let square: i128 = proxy.iter().map(|p| p * p).sum();
        along - self.m * square
    }

    fn end(&self) -> End<[i32; D]> {
        End { weight: self.m as u64, proxy: self.proxy().map(|p| p as i32) }
    }

    fn narrow(&self) -> ClusterSums<D> {
        ClusterSums { centroid: self.s.map(|s| s as i64), weight: self.m as i64, faces: self.faces }
    }
}
