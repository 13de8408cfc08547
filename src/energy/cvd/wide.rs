//! The sums in 128 bits, as their definition reads. The plain device computes with them; the narrow forms are compared
//! with it.

use super::{ClusterSums, End, Face};

/// Sums over the faces of a cluster.
#[derive(Debug, Clone, Default)]
pub struct Sums {
    /// S = Σ w·g.
    s: [i128; 3],
    /// M = Σ w.
    m: i128,
    /// Number of faces.
    pub faces: u32,
}

impl Sums {
    /// Adds a face.
    pub fn add_face(&mut self, face: Face) {
        let weight = i128::from(face.weight);
        for axis in 0..3 {
            self.s[axis] += weight * i128::from(face.centroid[axis]);
        }
        self.m += weight;
        self.faces += 1;
    }

    /// M.
    pub fn weight(&self) -> u64 {
        self.m as u64
    }

    /// P: S / M rounded to the nearest lattice point, halves up. The cluster has faces.
    pub fn proxy(&self) -> [i128; 3] {
        self.s.map(|s| (2 * s + self.m).div_euclid(2 * self.m))
    }

    /// |g − P|² of a face. The cluster has faces.
    pub fn cost(&self, face: Face) -> i128 {
        let proxy = self.proxy();
        (0..3).map(|axis| (i128::from(face.centroid[axis]) - proxy[axis]).pow(2)).sum()
    }

    /// 2·P·S − M·|P|². The cluster has faces.
    pub fn explained(&self) -> i128 {
        let proxy = self.proxy();
        let along: i128 = (0..3).map(|axis| 2 * proxy[axis] * self.s[axis]).sum();
        let square: i128 = proxy.iter().map(|p| p * p).sum();
        along - self.m * square
    }

    /// What a merge cost needs. The cluster has faces.
    pub fn end(&self) -> End {
        End { weight: self.m as u64, proxy: self.proxy().map(|p| p as i32) }
    }

    /// The same in 64 bits.
    pub fn narrow(&self) -> ClusterSums {
        ClusterSums { centroid: self.s.map(|s| s as i64), weight: self.m as i64, faces: self.faces }
    }
}
