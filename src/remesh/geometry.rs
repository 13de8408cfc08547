//! What vertices are placed by: areas, centroids, normals and sizes of the triangles.

use glam::DVec3;

use crate::complex::CutSurface;

/// Area, centroid, unit normal and size of the triangles, in the frame of their surface.
#[derive(Debug, Default)]
pub struct Geometry {
    /// Area, and at least a number so small that no area below it matters.
    pub weights: Vec<f64>,
    /// Mean of the corners.
    pub centroids: Vec<DVec3>,
    /// Unit normal; 0 without an area.
    pub normals: Vec<DVec3>,
    /// Distance from the centroid to the farthest corner.
    pub reaches: Vec<f64>,
}

impl Geometry {
    /// Of all triangles.
    pub fn new(surface: &CutSurface) -> Self {
        /// So that clusters without area have a centroid.
        const LEAST: f64 = 1e-290;
        let mut all = Self::default();
        for triangle in 0..surface.faces.len() as u32 {
            let [a, b, c] = surface.corners(triangle);
            let (normal, centroid) = ((b - a).cross(c - a), (a + b + c) / 3.0);
            let reach = [a, b, c].map(|corner| corner.distance_squared(centroid)).into_iter().fold(0.0, f64::max);
            all.weights.push((normal.length() / 2.0).max(LEAST));
            all.centroids.push(centroid);
            all.normals.push(normal.normalize_or_zero());
            all.reaches.push(reach.sqrt());
        }
        all
    }

    /// Area-weighted mean of the centroids of some triangles.
    pub fn mean(&self, triangles: &[u32]) -> DVec3 {
        let (mut weighted, mut weight) = (DVec3::ZERO, 0.0);
        for &triangle in triangles {
            weighted += self.weights[triangle as usize] * self.centroids[triangle as usize];
            weight += self.weights[triangle as usize];
        }
        weighted / weight
    }
}
