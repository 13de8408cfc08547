//! Where the vertices of the cells stand; [`super`] says what the placements are.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::closest::{closest, point};
use super::geometry::Geometry;
use super::quadric;
use crate::complex::CutSurface;
use crate::parallel;
use crate::surface::Rows;

/// Where the vertex of a cluster stands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// Near the surface in the sense of least squares.
    #[default]
    Fit,
    /// The point of the cluster's own faces that is nearest to its centroid.
    Surface,
    /// The cluster's centroid.
    Centroid,
}

/// A point of the surface: a triangle and barycentric coordinates.
pub type OnSurface = (u32, [f64; 3]);

/// Surface, geometry, and the triangles of each cell.
pub struct Cloth<'a> {
    /// The surface.
    pub surface: &'a CutSurface,
    /// Its geometry.
    pub geometry: &'a Geometry,
    /// The triangles of each cell.
    pub triangles_of_cells: &'a Rows,
}

impl Cloth<'_> {
    /// The vertex of each cell before anything is fitted; 0 without triangles.
    pub fn positions(&self, placement: Placement) -> Vec<DVec3> {
        let of_cell = |cell: usize| {
            let triangles = self.triangles_of_cells.of(cell as u32);
            if triangles.is_empty() {
                return DVec3::ZERO;
            }
            let mean = self.geometry.mean(triangles);
            match placement {
                Placement::Centroid => mean,
                Placement::Surface => self.on_surface(cell, mean),
                Placement::Fit => quadric::minimum(self.surface, self.geometry, triangles, mean),
            }
        };
        parallel::map(self.triangles_of_cells.count(), 1, of_cell)
    }

    /// The nearest point of a cell's triangles. No triangle is nearer than its centroid less its reach, so most are not
    /// looked at.
    pub fn nearest(&self, cell: usize, to: DVec3) -> Option<OnSurface> {
        let triangles = self.triangles_of_cells.of(cell as u32);
        let to_centroid = |triangle: u32| self.geometry.centroids[triangle as usize].distance_squared(to);
        let least = triangles.iter().map(|&triangle| to_centroid(triangle)).fold(f64::INFINITY, f64::min);
        // rounded up, so that its square is not below the least
        let enough = least.sqrt().next_up();
        let mut best = (f64::INFINITY, None);
        for &triangle in triangles {
            let limit = enough + self.geometry.reaches[triangle as usize];
            if to_centroid(triangle) > limit * limit {
                continue;
            }
            let corners = self.surface.corners(triangle);
            let weights = closest(to, corners);
            let distance = to.distance_squared(point(weights, corners));
            if distance < best.0 {
                best = (distance, Some((triangle, weights)));
            }
        }
        best.1
    }

    /// Where a vertex of a cell stands with [`Placement::Surface`]: nearest to a point, on the cell's own triangles.
    fn on_surface(&self, cell: usize, to: DVec3) -> DVec3 {
        self.nearest(cell, to).map_or(to, |(triangle, weights)| point(weights, self.surface.corners(triangle)))
    }

    /// Moves vertices of triangles that lie against their cells' mean normals half way back, at most five times: to the
    /// nearest point of the cell's triangles to its centroid, or to the place on an arc. Gives the
    /// number of triangles that still lie against them; without `is_free`, moves nothing.
    pub fn turn_back(&self, triangles: &[[u32; 3]], positions: &mut [DVec3], is_free: Option<&[bool]>) -> u64 {
        /// Times that a vertex goes half way back.
        const TURNS: usize = 5;
        let cells = self.triangles_of_cells.count();
        let normal = |cell: usize| {
            let of_triangle =
                |&triangle: &u32| self.geometry.weights[triangle as usize] * self.geometry.normals[triangle as usize];
            self.triangles_of_cells.of(cell as u32).iter().map(of_triangle).sum::<DVec3>().normalize_or_zero()
        };
        let normals = parallel::map(cells, 1, normal);
        let against = |positions: &[DVec3]| -> Vec<[u32; 3]> {
            let is_against = |triangle: &&[u32; 3]| {
                let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
                let of_cells = triangle.iter().filter_map(|&vertex| normals.get(vertex as usize));
                (b - a).cross(c - a).dot(of_cells.sum()) < 0.0
            };
            triangles.iter().filter(is_against).copied().collect()
        };
        let mut left = against(positions);
        let Some(is_free) = is_free else { return left.len() as u64 };
        let begin = positions.to_vec();
        let mut home: Vec<Option<DVec3>> = vec![None; positions.len()];
        for _ in 0..TURNS {
            let mut vertices: Vec<u32> = left.iter().copied().flatten().collect();
            vertices.sort_unstable();
            vertices.dedup();
            for vertex in vertices.into_iter().map(|vertex| vertex as usize).filter(|&vertex| is_free[vertex]) {
                let of_cell = || match vertex < cells {
                    true => self.on_surface(vertex, self.geometry.mean(self.triangles_of_cells.of(vertex as u32))),
                    false => begin[vertex],
                };
                let home = *home[vertex].get_or_insert_with(of_cell);
                positions[vertex] = (positions[vertex] + home) / 2.0;
            }
            left = against(positions);
            if left.is_empty() {
                break;
            }
        }
        left.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Faces, Format, PolygonMesh};

    #[test]
    fn a_triangle_that_is_a_point_beside_a_large_one_is_nearest() {
        let near = [[1.0, 2.0, 3.0], [1.5, 2.0, 3.0], [1.0, 2.5, 3.0]];
        let far = [[0.0, 0.0, 0.0], [4e36, 0.0, 0.0], [0.0, 1e35, 0.0]];
        let faces = Faces::from_triangles((0..6).collect());
        let mesh = PolygonMesh::of_one_part(Format::Obj, [near, far].concat(), faces);
        let surface = CutSurface::new(&mesh).expect("a surface");
        let (geometry, triangles_of_cells) = (Geometry::new(&surface), Rows::grouped(&[0, 1], 2));
        assert_eq!(geometry.reaches[0], 0.0);
        let cloth = Cloth { surface: &surface, geometry: &geometry, triangles_of_cells: &triangles_of_cells };
        for at in 1..1000 {
            let to = geometry.centroids[0] + DVec3::new(f64::from(at), 0.5, 0.1) / 1024.0;
            assert!(cloth.nearest(0, to).is_some(), "{at}");
        }
    }
}
