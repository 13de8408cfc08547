//! Points of the faces on the lattice, at which shapes are compared with them.
//!
//! A triangle has the middles of its edges: the mean squared distance of these from a plane is that of the triangle,
//! exactly, and they see how far a chord is from an arc. Corners alone do not: two sides of a box fit a cylinder
//! through the three edges along them. A polygon has the middles of its edges, too, of [`MOST`] at most; with more than
//! [`FEW`] also its own, since all edges of the bottom of a cylinder lie on its side.

use glam::DVec3;

use super::Surface;
use super::corners::Corners;
use super::lattice::round_centroid;
use crate::parallel;

/// Edges of a face that have a sample, at most.
const MOST: usize = 64;

/// Corners of a face whose edges suffice.
const FEW: usize = 4;

/// Unit normals are multiplied by 2 to this power.
pub const NORMAL_BITS: u32 = 14;

/// Samples of all faces, internal order.
#[derive(Debug, Clone)]
pub struct Samples {
    /// First sample of each face, and one past the last.
    pub offsets: Vec<u32>,
    points: Vec<[i32; 3]>,
    normals: Vec<[i16; 3]>,
}

impl Samples {
    /// Those of a face, at least one.
    #[inline]
    pub fn of(&self, face: u32) -> &[[i32; 3]] {
        &self.points[self.offsets[face as usize] as usize..self.offsets[face as usize + 1] as usize]
    }

    /// Those of all faces, one face after the other.
    pub fn points(&self) -> &[[i32; 3]] {
        &self.points
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
        Self { offsets, points, normals: faces.iter().map(|&(_, normal)| normal).collect() }
    }
}

impl Surface {
    /// Samples of faces with these corners, on a surface with normals.
    pub fn samples(&self, corners: &Corners) -> Samples {
        let faces = corners.faces.len() as u32;
        let of_face = |face: u32| {
            let vertices = corners.of(face);
            let count = vertices.len().min(MOST);
            let middle = (vertices.len() > FEW).then(|| round_centroid(self.geometry[face as usize].centroid));
            let of_edges = (0..count).map(move |number| {
                let edge = number * vertices.len() / count;
                let ends = [edge, (edge + 1) % vertices.len()].map(|at| corners.position(vertices[at]));
                round_centroid((ends[0] + ends[1]) / 2.0)
            });
            of_edges.chain(middle)
        };
        let ends = (0..faces).scan(0, |sum, face| {
            let corners = corners.of(face).len();
            *sum += corners.min(MOST) as u32 + u32::from(corners > FEW);
            Some(*sum)
        });
        let offsets = std::iter::once(0).chain(ends).collect();
        let points = parallel::list(faces as usize, parallel::LEAST, &|faces, points| {
            points.extend((faces.start as u32..faces.end as u32).flat_map(of_face));
        });
        let normals = parallel::map(self.normals.len(), parallel::LEAST, |face| {
            (self.normals[face] * f64::from(1 << NORMAL_BITS)).to_array().map(|axis| (axis + 0.5).floor() as i16)
        });
        Samples { offsets, points, normals }
    }

    /// The area of a face, its normal, which is as long as the area is large, and its mean place; lattice units.
    pub fn area_normal_and_place(&self, face: u32) -> (f64, DVec3, DVec3) {
        let geometry = &self.geometry[face as usize];
        (geometry.area, self.normal(face as usize) * geometry.area, geometry.centroid)
    }
}
