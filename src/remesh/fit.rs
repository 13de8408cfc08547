//! Vertices by least squares: the mesh comes near the surface everywhere, not only at its vertices.
//!
//! Twice: the centroid g of every triangle of the surface finds its nearest point q among the triangles of the mesh
//! *around its own cell's vertex*, with barycentric coordinates B. That cannot be on another sheet, and is as good as a
//! search over the whole mesh (mean distances within 1 %). Then steps d of the vertices minimise
//!
//! ```text
//! Σ w·|B·d − (g − q)|² + λ·Σ |d|²
//! ```
//!
//! with areas w whose sum is the number of vertices, and λ = 0.05. Its normal equations are sums over the triangles
//! of the mesh, so the matrix is never put together: the method of conjugate gradients, some ten steps, multiplies
//! triangle by triangle. Vertices on the boundary do not take part.

use glam::DVec3;
use rayon::prelude::*;

use super::closest::{closest, point};
use super::geometry::{Geometry, Rows};

/// Least squares run as often.
const ROUNDS: usize = 2;
/// How firmly vertices stay.
const STIFFNESS: f64 = 0.05;
/// Conjugate gradients end when what is left is this part of what there was.
const TOLERANCE: f64 = 1e-4;
/// And after as many steps.
const STEPS: usize = 60;

/// What is fitted.
pub struct Fit<'a> {
    /// The triangles of the surface.
    pub geometry: &'a Geometry,
    /// Those of each cell.
    pub triangles_of_cells: &'a Rows,
    /// The triangles of the mesh.
    pub triangles: &'a [[u32; 3]],
    /// Whether each vertex may move.
    pub is_free: &'a [bool],
}

/// Sums over the surface's triangles that found a triangle of the mesh.
#[derive(Debug, Clone, Copy, Default)]
struct Found {
    /// Σ w·Bᵢ·Bⱼ: 00, 11, 22, 01, 02, 12.
    products: [f64; 6],
    /// Σ w·Bᵢ·(g − q).
    errors: [DVec3; 3],
}

impl Found {
    fn add(&mut self, weight: f64, [a, b, c]: [f64; 3], error: DVec3) {
        for (sum, product) in self.products.iter_mut().zip([a * a, b * b, c * c, a * b, a * c, b * c]) {
            *sum += weight * product;
        }
        for (sum, share) in self.errors.iter_mut().zip([a, b, c]) {
            *sum += weight * share * error;
        }
    }

    fn add_all(&mut self, other: &Found) {
        self.products.iter_mut().zip(other.products).for_each(|(sum, product)| *sum += product);
        self.errors.iter_mut().zip(other.errors).for_each(|(sum, error)| *sum += error);
    }
}

impl Fit<'_> {
    /// Moves vertices. The first vertices are those of the cells.
    pub fn run(&self, positions: &mut [DVec3]) {
        let cells = self.triangles_of_cells.len();
        let mut corners: Vec<(u32, u32)> = Vec::with_capacity(3 * self.triangles.len());
        for (triangle, vertices) in (0..).zip(self.triangles) {
            corners
                .extend(vertices.iter().filter(|&&vertex| (vertex as usize) < cells).map(|&vertex| (vertex, triangle)));
        }
        corners.sort_unstable();
        let rows: Vec<&[(u32, u32)]> = {
            let begin = |cell: usize| corners.partition_point(|&(vertex, _)| (vertex as usize) < cell);
            (0..cells).map(|cell| &corners[begin(cell)..begin(cell + 1)]).collect()
        };
        let total: f64 = self.geometry.weights.iter().sum();
        let scale = positions.len() as f64 / total;
        for _ in 0..ROUNDS {
            let found = self.found(&rows, scale, positions);
            let steps = self.solve(&found, positions.len());
            positions.iter_mut().zip(steps).for_each(|(position, step)| *position += step);
        }
    }

    /// Sums for each triangle of the mesh; `rows` has those around each cell's vertex.
    fn found(&self, rows: &[&[(u32, u32)]], scale: f64, positions: &[DVec3]) -> Vec<Found> {
        let of_cell = |cell: usize| {
            let around: Vec<[DVec3; 3]> = rows[cell]
                .iter()
                .map(|&(_, triangle)| self.triangles[triangle as usize].map(|vertex| positions[vertex as usize]))
                .collect();
            let mut found = vec![Found::default(); around.len()];
            for &triangle in self.triangles_of_cells.row(cell) {
                let target = self.geometry.centroids[triangle as usize];
                let mut best = (f64::INFINITY, 0, [0.0; 3], DVec3::ZERO);
                for (slot, &corners) in around.iter().enumerate() {
                    let weights = closest(target, corners);
                    let error = target - point(weights, corners);
                    if error.length_squared() < best.0 {
                        best = (error.length_squared(), slot, weights, error);
                    }
                }
                let (_, slot, weights, error) = best;
                if let Some(found) = found.get_mut(slot) {
                    found.add(scale * self.geometry.weights[triangle as usize], weights, error);
                }
            }
            found
        };
        let of_corners: Vec<Found> = (0..rows.len()).into_par_iter().flat_map_iter(of_cell).collect();
        let mut all = vec![Found::default(); self.triangles.len()];
        for (&(_, triangle), found) in rows.iter().copied().flatten().zip(&of_corners) {
            all[triangle as usize].add_all(found);
        }
        all
    }

    /// The steps of all vertices, by conjugate gradients; each axis is a system of its own.
    fn solve(&self, found: &[Found], vertices: usize) -> Vec<DVec3> {
        let mut right = vec![DVec3::ZERO; vertices];
        for (triangle, found) in self.triangles.iter().zip(found) {
            for (&vertex, &error) in triangle.iter().zip(&found.errors) {
                right[vertex as usize] += error;
            }
        }
        self.hold(&mut right);
        let mut steps = vec![DVec3::ZERO; vertices];
        let mut direction = right.clone();
        let mut left = dot(&right, &right);
        let enough = left * (TOLERANCE * TOLERANCE);
        for _ in 0..STEPS {
            // an axis that is near enough stays
            let runs = left.cmpgt(enough);
            if !runs.any() {
                break;
            }
            let product = self.multiply(found, &direction);
            let pace = DVec3::select(runs, left / dot(&direction, &product), DVec3::ZERO);
            for (step, &direction) in steps.iter_mut().zip(&direction) {
                *step += pace * direction;
            }
            for (rest, &product) in right.iter_mut().zip(&product) {
                *rest -= pace * product;
            }
            let now = dot(&right, &right);
            let turn = DVec3::select(runs, now / left, DVec3::ZERO);
            for (direction, &rest) in direction.iter_mut().zip(&right) {
                *direction = rest + turn * *direction;
            }
            left = now;
        }
        steps
    }

    fn multiply(&self, found: &[Found], vector: &[DVec3]) -> Vec<DVec3> {
        let mut product: Vec<DVec3> = vector.iter().map(|&of_vertex| STIFFNESS * of_vertex).collect();
        for (triangle, Found { products: [aa, bb, cc, ab, ac, bc], .. }) in self.triangles.iter().zip(found) {
            let [a, b, c] = triangle.map(|vertex| vector[vertex as usize]);
            let of = [aa * a + ab * b + ac * c, ab * a + bb * b + bc * c, ac * a + bc * b + cc * c];
            for (&vertex, of) in triangle.iter().zip(of) {
                product[vertex as usize] += of;
            }
        }
        self.hold(&mut product);
        product
    }

    /// Keeps vertices where they are that may not move.
    fn hold(&self, vector: &mut [DVec3]) {
        vector.iter_mut().zip(self.is_free).filter(|(_, is_free)| !**is_free).for_each(|(of, _)| *of = DVec3::ZERO);
    }
}

/// The three scalar products, one an axis.
fn dot(one: &[DVec3], other: &[DVec3]) -> DVec3 {
    one.iter().zip(other).map(|(&one, &other)| one * other).sum()
}
