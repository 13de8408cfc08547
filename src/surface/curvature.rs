//! How much the surface bends at each face.
//!
//! Every vertex gets the area-weighted mean T of n·nᵀ over its faces, n being a face's unit normal: unlike a mean of
//! normals it does not depend on how faces are wound, and does not vanish where two sheets meet. Over the edges ij of a
//! face,
//!
//! ```text
//! κ² = ½·Σ |T_i − T_j|² / Σ |x_i − x_j|²
//! ```
//!
//! For small angles |T_i − T_j|² is twice the squared angle between the normals, so κ² is the squared normal curvature
//! averaged over the edges' directions: 1/r² on a sphere, half of that on a cylinder. A quotient of sums is defined for
//! slivers (one short edge or an area near 0) and for polygons of any number of corners. Then, against the noise of
//! scans, each vertex takes the mean of its faces, weighted by area, and each face the mean of its corners.
//!
//! Scalar f64 with + − × ÷ √ in a fixed order.

use super::lattice::FaceGeometry;
use super::weld::Weld;
use crate::mesh::{Frame, MeshView};

/// Upper half of a symmetric matrix: xx, yy, zz, xy, xz, yz.
type Symmetric = [f64; 6];

/// κ² of each face in lattice units, upload order.
pub fn squared_curvatures(mesh: MeshView<'_>, weld: &Weld, frame: &Frame, geometry: &[FaceGeometry]) -> Vec<f64> {
    let vertex = |corner: u32| weld.position_of_vertex[corner as usize] as usize;
    let vertices = weld.vertices as usize;
    let tensors = normal_tensors(mesh, weld, frame);
    let rough = |face: usize| {
        let corners = mesh.faces.corners(face);
        let (mut bend, mut length) = (0.0, 0.0);
        for (at, &corner) in corners.iter().enumerate() {
            let next = corners[(at + 1) % corners.len()];
            if let (Some(a), Some(b)) = (tensors[vertex(corner)], tensors[vertex(next)]) {
                bend += squared_difference(&a, &b);
                let [a, b] = [corner, next].map(|corner| frame.position(mesh.positions.at(corner as usize)));
                length += a.distance_squared(b);
            }
        }
        if length > 0.0 { bend / (2.0 * length) } else { 0.0 }
    };
    let mut sums = vec![(0.0, 0.0); vertices];
    for (face, geometry) in geometry.iter().enumerate() {
        let curvature = rough(face);
        for &corner in mesh.faces.corners(face) {
            let (weighted, area) = &mut sums[vertex(corner)];
            *weighted += geometry.area * curvature;
            *area += geometry.area;
        }
    }
    let mean = |corner: u32| {
        let (weighted, area) = sums[vertex(corner)];
        if area > 0.0 { weighted / area } else { 0.0 }
    };
    let smooth = |face: usize| {
        let corners = mesh.faces.corners(face);
        corners.iter().map(|&corner| mean(corner)).sum::<f64>() / corners.len() as f64
    };
    (0..mesh.faces.len()).map(smooth).collect()
}

/// T of each vertex; none where no face has an area.
fn normal_tensors(mesh: MeshView<'_>, weld: &Weld, frame: &Frame) -> Vec<Option<Symmetric>> {
    let mut sums = vec![([0.0; 6], 0.0); weld.vertices as usize];
    for face in 0..mesh.faces.len() {
        let normal = frame.vector_area(mesh, face);
        let area = normal.length();
        if area <= 0.0 {
            continue;
        }
        let [x, y, z] = normal.to_array();
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        for &corner in mesh.faces.corners(face) {
            let (sum, areas) = &mut sums[weld.position_of_vertex[corner as usize] as usize];
            for (sum, product) in sum.iter_mut().zip(products) {
                *sum += product / area;
            }
            *areas += area;
        }
    }
    sums.into_iter().map(|(sum, area)| (area > 0.0).then(|| sum.map(|sum| sum / area))).collect()
}

/// |A − B|², the sum of squares of all nine elements.
fn squared_difference(a: &Symmetric, b: &Symmetric) -> f64 {
    let d: Symmetric = std::array::from_fn(|at| (a[at] - b[at]) * (a[at] - b[at]));
    d[0] + d[1] + d[2] + 2.0 * (d[3] + d[4] + d[5])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};
    use crate::mesh::PolygonMesh;
    use crate::surface::lattice::COORDINATE_BITS;
    use crate::surface::weld;

    /// κ of each face in source units.
    fn curvatures(mesh: &PolygonMesh) -> Vec<f64> {
        let mesh = MeshView::from(mesh);
        let frame = Frame::of(mesh.positions.iter(), COORDINATE_BITS);
        let geometry = frame.faces(mesh, |_| None);
        let squared = squared_curvatures(mesh, &weld::weld(mesh).0, &frame, &geometry);
        squared.into_iter().map(|squared| libm::ldexp(squared.sqrt(), frame.exponent)).collect()
    }

    fn scaled(mesh: &PolygonMesh, factor: f64) -> PolygonMesh {
        let positions = mesh.positions.iter().map(|p| p.map(|x| x * factor)).collect();
        PolygonMesh { positions, ..mesh.clone() }
    }

    #[test]
    fn spheres_have_the_reciprocal_of_their_radius() {
        let sphere = generate(Sample::Sphere, 5000).expect("a sample");
        let radius = sphere.positions[0].iter().map(|x| x * x).sum::<f64>().sqrt();
        for factor in [1.0, 1e-3, 1e200] {
            for curvature in curvatures(&scaled(&sphere, factor)) {
                let product = curvature * radius * factor;
                assert!((0.92..1.05).contains(&product), "{product}");
            }
        }
    }

    #[test]
    fn polygons_bend_as_their_triangles_do_and_planes_not_at_all() {
        let quads = generate(Sample::Quads, 4000).expect("a sample");
        assert!(quads.faces.triangles() > quads.faces.len() as u64);
        let mut cut = quads.clone();
        cut.faces = crate::mesh::Faces::default();
        for face in 0..quads.faces.len() {
            let corners = quads.faces.corners(face);
            for at in 1..corners.len() - 1 {
                cut.faces.push(&[corners[0], corners[at], corners[at + 1]]);
            }
        }
        let mean = |all: Vec<f64>| all.iter().sum::<f64>() / all.len() as f64;
        let (whole, cut) = (mean(curvatures(&quads)), mean(curvatures(&cut)));
        assert!((whole / cut - 1.0).abs() < 0.15, "{whole} {cut}");
        let flat = scaled(&generate(Sample::Terrain, 500).expect("a sample"), 1.0);
        let positions = flat.positions.iter().map(|&[x, y, _]| [x, y, 0.0]).collect();
        assert!(curvatures(&PolygonMesh { positions, ..flat }).iter().all(|&curvature| curvature < 1e-6));
    }

    #[test]
    fn winding_does_not_matter() {
        let mesh = generate(Sample::Knot, 2000).expect("a sample");
        let mut turned = mesh.clone();
        turned.faces = crate::mesh::Faces::default();
        for face in 0..mesh.faces.len() {
            let mut corners = mesh.faces.corners(face).to_vec();
            if face % 3 == 0 {
                corners.reverse();
            }
            turned.faces.push(&corners);
        }
        for (one, other) in curvatures(&mesh).into_iter().zip(curvatures(&turned)) {
            assert!((one / other - 1.0).abs() < 1e-9, "{one} {other}");
        }
    }
}
