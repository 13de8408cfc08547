//! Points of the faces on the lattice, at which shapes are compared with them.
//!
//! A triangle has the middles of its edges: the mean squared distance of these from a plane is that of the triangle,
//! exactly, and they see how far a chord is from an arc. Corners alone do not: two sides of a box fit a cylinder
//! through the three edges along them. A polygon has the middles of its edges, too, of [`MOST`] at most.

use rayon::prelude::*;

use super::Surface;
use super::lattice::round_centroid;
use crate::mesh::MeshView;

/// Samples of a face at most.
const MOST: usize = 64;

/// Unit normals are multiplied by 2 to this power.
const NORMAL_BITS: u32 = 14;

/// Samples of all faces, internal order.
#[derive(Debug, Clone)]
pub struct Samples {
    /// First sample of each face, and one past the last; none where every face has three.
    offsets: Option<Vec<u32>>,
    points: Vec<[i32; 3]>,
    normals: Vec<[i16; 3]>,
}

impl Samples {
    /// Those of a face, at least one.
    #[inline]
    pub fn of(&self, face: u32) -> &[[i32; 3]] {
        let face = face as usize;
        match &self.offsets {
            None => &self.points[3 * face..3 * face + 3],
            Some(offsets) => &self.points[offsets[face] as usize..offsets[face + 1] as usize],
        }
    }

    /// The unit normal of a face × 2¹⁴, 0 without area.
    pub fn normal(&self, face: u32) -> [i64; 3] {
        self.normals[face as usize].map(i64::from)
    }

    /// Those of given faces.
    #[cfg(test)]
    pub fn new(faces: &[(Vec<[i32; 3]>, [i16; 3])]) -> Self {
        let mut offsets = vec![0];
        offsets.extend(faces.iter().scan(0, |sum, (samples, _)| {
            *sum += samples.len() as u32;
            Some(*sum)
        }));
        let points = faces.iter().flat_map(|(samples, _)| samples.iter().copied()).collect();
        Self { offsets: Some(offsets), points, normals: faces.iter().map(|&(_, normal)| normal).collect() }
    }
}

impl Surface {
    /// Samples of the faces of the mesh that this surface was built of.
    pub fn samples(&self, mesh: MeshView<'_>) -> Samples {
        let corners = |face: u32| mesh.faces.corners(face as usize);
        let count = |face: u32| corners(face).len().clamp(1, MOST);
        let upload_face = &self.items.upload_face;
        let are_triangles = mesh.faces.are_triangles();
        let offsets = (!are_triangles).then(|| {
            let ends = upload_face.iter().scan(0, |sum, &face| {
                *sum += count(face) as u32;
                Some(*sum)
            });
            std::iter::once(0).chain(ends).collect::<Vec<u32>>()
        });
        let position = |corner: u32| self.frame.position(mesh.positions.at(corner as usize));
        let sample = |face: u32, number: usize| {
            let corners = corners(face);
            let edge = number * corners.len() / count(face);
            let [a, b] = [edge, (edge + 1) % corners.len()].map(|at| position(corners[at]));
            round_centroid((a + b) / 2.0)
        };
        let points = match are_triangles {
            true => upload_face.par_iter().flat_map_iter(|&face| (0..3).map(move |at| sample(face, at))).collect(),
            false => upload_face.iter().flat_map(|&face| (0..count(face)).map(move |at| sample(face, at))).collect(),
        };
        let normals = self.geometry.par_iter().map(|face| {
            let scale = if face.area > 0.0 { f64::from(1 << NORMAL_BITS) / face.area } else { 0.0 };
            (face.normal * scale).to_array().map(|axis| (axis + 0.5).floor() as i16)
        });
        Samples { offsets, points, normals: normals.collect() }
    }
}
