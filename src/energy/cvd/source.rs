//! The energy in f64, from source positions: for reports, never for labels.

/// Σ area·|g − P|², P the area-weighted mean of the cluster's centroids (P§6, Eq. 4). Takes the centroid g, the area
/// and the label of each face; sums go in the order of the faces.
pub fn source_energy(faces: impl Iterator<Item = ([f64; 3], f64, u32)> + Clone, clusters: usize) -> f64 {
    let mut sums = vec![[0.0f64; 4]; clusters];
    for (centroid, area, label) in faces.clone() {
        let sum = &mut sums[label as usize];
        for axis in 0..3 {
            sum[axis] += area * centroid[axis];
        }
        sum[3] += area;
    }
    for sum in &mut sums {
        let area = if sum[3] > 0.0 { sum[3] } else { 1.0 };
        for axis in 0..3 {
            sum[axis] /= area;
        }
    }
    let mut energy = 0.0;
    for (centroid, area, label) in faces {
        let proxy = &sums[label as usize];
        let d: [f64; 3] = std::array::from_fn(|axis| centroid[axis] - proxy[axis]);
        energy += area * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    }
    energy
}
