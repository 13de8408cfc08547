//! Vertices by least squares: the mesh comes near the surface everywhere, not only at its vertices.
//!
//! Twice: the centroid g of every triangle of the surface finds its nearest point q among the triangles of the mesh
//! *around its own cell's vertex*, with barycentric coordinates B. That cannot be on another sheet, and is as good as a
//! search over the whole mesh (mean distances within 1 %). A lower bound of the distance ([`Candidate::bound`]) leaves
//! one or two of these triangles to be looked at. Then steps d of the vertices minimise
//!
//! ```text
//! Σ w·|B·d − (g − q)|² + λ·Σ |d|²
//! ```
//!
//! with areas w whose sum is the number of vertices, and λ = 0.05. Its normal equations are sums over the triangles
//! of the mesh, so the matrix is never put together: the method of conjugate gradients, some ten steps, multiplies
//! triangle by triangle. Vertices on the boundary do not take part.

use glam::DVec3;

use super::closest::{closest, point};
use super::geometry::Geometry;
use crate::parallel;
use crate::surface::Rows;

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

/// A triangle of the mesh that may have the nearest point.
struct Candidate {
    corners: [DVec3; 3],
    /// Its unit normal.
    normal: DVec3,
    /// Unit vectors in its plane, out of it across each side; side i begins at corner i.
    outward: [DVec3; 3],
}

impl Candidate {
    fn new(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let outward = [b - a, c - b, a - c].map(|side| side.cross(normal).normalize_or_zero());
        Self { corners, normal, outward }
    }

    /// A lower bound of the squared distance from a point, without rounding: of the distance to its plane and, within
    /// the plane, that to the half-planes whose intersection it is.
    #[inline]
    fn bound(&self, point: DVec3) -> f64 {
        let from = self.corners.map(|corner| point - corner);
        let [one, two, three] = [0, 1, 2].map(|side| self.outward[side].dot(from[side]));
        let (above, beside) = (self.normal.dot(from[0]), one.max(two).max(three).max(0.0));
        above * above + beside * beside
    }

    fn look(&self, slot: usize, target: DVec3) -> Nearest {
        let weights = closest(target, self.corners);
        let error = target - point(weights, self.corners);
        Nearest { slot, weights, error, distance: error.length_squared() }
    }
}

/// The nearest point among some triangles.
struct Nearest {
    slot: usize,
    weights: [f64; 3],
    /// From the nearest point to the target.
    error: DVec3,
    /// Squared.
    distance: f64,
}

impl Nearest {
    /// Looks at the triangle with the lowest bound first, then at those whose bounds are below what was found.
    fn new(around: &[Candidate], bounds: &mut [f64], target: DVec3) -> Option<Self> {
        let (mut first, mut least) = (0, f64::INFINITY);
        for (slot, (candidate, bound)) in around.iter().zip(&mut *bounds).enumerate() {
            *bound = candidate.bound(target);
            if *bound < least {
                (first, least) = (slot, *bound);
            }
        }
        let mut best = around.get(first)?.look(first, target);
        for (slot, candidate) in around.iter().enumerate() {
            if bounds[slot] < best.distance && slot != first {
                let other = candidate.look(slot, target);
                if other.distance < best.distance {
                    best = other;
                }
            }
        }
        Some(best)
    }
}

impl Fit<'_> {
    /// Moves vertices. The first vertices are those of the cells.
    pub fn run(&self, positions: &mut [DVec3]) {
        let cells = self.triangles_of_cells.count();
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
            let corners = |triangle: u32| self.triangles[triangle as usize].map(|vertex| positions[vertex as usize]);
            let around: Vec<Candidate> =
                rows[cell].iter().map(|&(_, triangle)| Candidate::new(corners(triangle))).collect();
            let mut found = vec![Found::default(); around.len()];
            let mut bounds = vec![0.0; around.len()];
            for &triangle in self.triangles_of_cells.of(cell as u32) {
                let target = self.geometry.centroids[triangle as usize];
                if let Some(Nearest { slot, weights, error, .. }) = Nearest::new(&around, &mut bounds, target) {
                    found[slot].add(scale * self.geometry.weights[triangle as usize], weights, error);
                }
            }
            found
        };
        let of_corners: Vec<Found> =
            parallel::list(rows.len(), 1, &|cells, found| found.extend(cells.flat_map(of_cell)));
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
