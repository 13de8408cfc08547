//! What vertices are placed by: areas, centroids, normals and sizes of the triangles, and which triangles each cell
//! has.

use glam::DVec3;
use rayon::prelude::*;

use crate::complex::CutSurface;

/// Rows of numbers, one row after the other.
#[derive(Debug)]
pub struct Rows {
    begin: Vec<u32>,
    items: Vec<u32>,
}

impl Rows {
    /// Row r has the items i, ascending, for which `row_of` has r.
    pub fn new(rows: usize, row_of: &[u32]) -> Self {
        let mut begin = vec![0; rows + 1];
        row_of.iter().for_each(|&row| begin[row as usize + 1] += 1);
        for row in 0..rows {
            begin[row + 1] += begin[row];
        }
        let mut next = begin.clone();
        let mut items = vec![0; row_of.len()];
        for (item, &row) in (0..).zip(row_of) {
            let at = &mut next[row as usize];
            items[*at as usize] = item;
            *at += 1;
        }
        Self { begin, items }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.begin.len() - 1
    }

    /// The items of all rows.
    pub fn items(&self) -> &[u32] {
        &self.items
    }

    /// Where a row is among the items of all rows.
    pub fn range(&self, row: usize) -> std::ops::Range<usize> {
        self.begin[row] as usize..self.begin[row + 1] as usize
    }

    /// The items of a row.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.items[self.range(row)]
    }
}

/// Area, centroid, unit normal and size of the triangles, in the frame of their surface.
#[derive(Debug)]
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
        let of = |triangle: usize| {
            let [a, b, c] = surface.corners(triangle as u32);
            let (normal, centroid) = ((b - a).cross(c - a), (a + b + c) / 3.0);
            let reach = [a, b, c].map(|corner| corner.distance_squared(centroid)).into_iter().fold(0.0, f64::max);
            (((normal.length() / 2.0).max(LEAST), centroid), (normal.normalize_or_zero(), reach.sqrt()))
        };
        let ((weights, centroids), (normals, reaches)) = (0..surface.faces.len()).into_par_iter().map(of).unzip();
        Self { weights, centroids, normals, reaches }
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
