//! Where a cluster's vertex best stands for its planes.
//!
//! The squared distance from x to the planes of a cluster's triangles, weighted by area, is a quadric. Its minimum is
//! taken about the centroid c, along the eigenvectors of its matrix A whose eigenvalues reach [`LEAST`] of the largest;
//! along the others, the planes hardly say where to stand, and x stays at c. With 10⁻³ in the place of [`LEAST`],
//! vertices slide along the surface: on the bunny in 1,000 clusters the mean smallest angle falls from 49.1° to 44.4°.

use glam::DVec3;

use super::geometry::Geometry;
use crate::complex::CutSurface;

/// Eigenvalues below this part of the largest do not count.
const LEAST: f64 = 0.1;

/// The minimum of the quadric of some triangles about their mean; the mean itself if the minimum is farther from it
/// than all of their corners.
pub fn minimum(surface: &CutSurface, geometry: &Geometry, triangles: &[u32], mean: DVec3) -> DVec3 {
    let mut matrix = [[0.0; 3]; 3];
    let (mut right, mut reach) = (DVec3::ZERO, 0.0f64);
    for &triangle in triangles {
        let at = triangle as usize;
        let (weight, normal) = (geometry.weights[at], geometry.normals[at]);
        let distance = (geometry.centroids[at] - mean).dot(normal);
        right += weight * distance * normal;
        for i in 0..3 {
            for j in 0..3 {
                matrix[i][j] += weight * normal[i] * normal[j];
            }
        }
        for corner in surface.corners(triangle) {
            reach = reach.max(corner.distance_squared(mean));
        }
    }
    let (values, vectors) = eigen(matrix);
    let largest = values.iter().copied().fold(0.0, f64::max);
    let mut step = DVec3::ZERO;
    for (value, vector) in values.into_iter().zip(vectors) {
        if value > LEAST * largest {
            step += vector * (vector.dot(right) / value);
        }
    }
    // also false if it is no number
    if step.length_squared() <= reach { mean + step } else { mean }
}

/// Eigenvalues and unit eigenvectors of a symmetric matrix, by Jacobi's rotations.
fn eigen(mut a: [[f64; 3]; 3]) -> ([f64; 3], [DVec3; 3]) {
    /// Each sweep at least squares what is left beside the diagonal.
    const SWEEPS: usize = 12;
    let mut vectors = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let beside = a[p][q];
            if beside == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * beside);
            let tangent = 1.0f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            let r = 3 - p - q;
            let (of_p, of_q) = (a[r][p], a[r][q]);
            a[p][p] -= tangent * beside;
            a[q][q] += tangent * beside;
            (a[p][q], a[q][p]) = (0.0, 0.0);
            a[r][p] = cosine * of_p - sine * of_q;
            a[r][q] = sine * of_p + cosine * of_q;
            (a[p][r], a[q][r]) = (a[r][p], a[r][q]);
            let (v, w) = (vectors[p], vectors[q]);
            (vectors[p], vectors[q]) = (cosine * v - sine * w, sine * v + cosine * w);
        }
    }
    ([a[0][0], a[1][1], a[2][2]], vectors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::complex::CutSurface;
    use crate::dev::sample::{Sample, generate};

    #[test]
    fn eigenvectors_are_stretched_by_their_eigenvalues() {
        let matrices = [
            [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]],
            [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]],
            [[4.0, -2.0, 0.5], [-2.0, 1.5, 3.0], [0.5, 3.0, -7.0]],
            [[0.0; 3]; 3],
            [[1e-300, 1e-300, 0.0], [1e-300, 1e-300, 0.0], [0.0, 0.0, 1e-300]],
        ];
        for matrix in matrices {
            let (values, vectors) = eigen(matrix);
            let size = matrix.as_flattened().iter().fold(0.0f64, |size, x| size.max(x.abs()));
            for i in 0..3 {
                let product = DVec3::from(matrix.map(|row| DVec3::from(row).dot(vectors[i])));
                assert!((product - values[i] * vectors[i]).length() <= 1e-12 * size, "{matrix:?}");
                for j in 0..3 {
                    assert!((vectors[i].dot(vectors[j]) - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn corners_of_a_cube_are_found_and_flat_clusters_stay_at_their_centroids() {
        let mesh = generate(Sample::Cube, 1200).expect("a sample");
        let surface = CutSurface::new(&mesh).expect("a surface");
        let geometry = Geometry::new(&surface);
        let corner = surface.points.iter().copied().fold(DVec3::ZERO, |high, point| high.max(point));
        let at_corner = |triangle: &u32| surface.corners(*triangle).iter().any(|point| point.distance(corner) < 0.3);
        let near: Vec<u32> = (0..surface.faces.len() as u32).filter(at_corner).collect();
        assert!(near.len() > 10);
        let mean = geometry.mean(&near);
        assert!(minimum(&surface, &geometry, &near, mean).distance(corner) < 1e-9);
        let flat: Vec<u32> = near.into_iter().filter(|&triangle| geometry.normals[triangle as usize].x > 0.9).collect();
        let mean = geometry.mean(&flat);
        assert!(minimum(&surface, &geometry, &flat, mean).distance(mean) < 1e-9);
    }
}
