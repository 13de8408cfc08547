//! The exact integer sums of a cluster, and the proxy that they give. Bounds are derived in `docs/arithmetic.md`.

use crate::surface::DualGraph;

/// The sums over the faces of a cluster.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ClusterSums {
    /// S = Σ w·g, |S| < 2⁶¹ an axis.
    pub centroid: [i64; 3],
    /// M = Σ w < 2³⁴.
    pub weight: i64,
    /// Number of faces.
    pub faces: u32,
}

impl ClusterSums {
    /// Adds a face (`sign` 1) or takes it away (−1).
    pub fn add_face(&mut self, graph: &DualGraph, face: usize, sign: i64) {
        let weight = i64::from(graph.weights[face]);
        let centroid = graph.centroids[face].map(|g| weight * i64::from(g));
        self.add(&Self { centroid, weight, faces: 1 }, sign);
    }

    /// Adds other faces (`sign` 1) or takes them away (−1).
    pub fn add(&mut self, other: &Self, sign: i64) {
        for axis in 0..3 {
            self.centroid[axis] += sign * other.centroid[axis];
        }
        self.weight += sign * other.weight;
        self.faces = self.faces.wrapping_add_signed(sign as i32 * other.faces as i32);
    }

    /// The proxy P, the lattice point nearest to S/M (per axis, halves up). None without faces.
    pub fn proxy(&self) -> Option<[i32; 3]> {
        let nearest = |s: i64| (2 * s + self.weight).div_euclid(2 * self.weight) as i32;
        (self.faces > 0).then(|| self.centroid.map(nearest))
    }

    /// The proxy P and 2·P·S − M·|P|², what it explains of the energy; |explained| < 2⁹¹. None without faces.
    pub fn fit(&self) -> Option<([i32; 3], i128)> {
        let proxy = self.proxy()?;
        let mut along = 0;
        let mut square = 0;
        for axis in 0..3 {
            along += i128::from(proxy[axis]) * i128::from(self.centroid[axis]);
            square += i64::from(proxy[axis]) * i64::from(proxy[axis]);
        }
        Some((proxy, 2 * along - i128::from(self.weight) * i128::from(square)))
    }
}

/// Squared distance between two lattice points, below 2⁵⁸.
pub fn squared_distance(a: [i32; 3], b: [i32; 3]) -> u64 {
    let square = |axis: usize| {
        let difference = i64::from(a[axis]) - i64::from(b[axis]);
        (difference * difference) as u64
    };
    square(0) + square(1) + square(2)
}
