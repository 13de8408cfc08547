//! Meshes with smaller faces: polygons become the triangles of their fans, and every triangle becomes four, again and
//! again.
//!
//! A remesh is good with some thirty faces a cluster, which a coarse mesh does not have. The surface stays as it is: a
//! new vertex is the middle of an edge, the same for all triangles at it. Vertices of the mesh keep their numbers.
//! Only triangles with the same three corners come apart: edges inside them have more than two triangles then.
//!
//! ```text
//!            c
//!           / \
//!          / 2 \
//!        ca ─── bc
//!        / \ 3 / \
//!       / 0 \ / 1 \
//!      a ─── ab ── b
//! ```
//!
//! After n divisions, the parts of triangle t are the faces t·4ⁿ to t·4ⁿ + 4ⁿ − 1. The digits of a part's number in
//! base 4, the highest first, say which of the four it was in at each division. So [`Origin`] needs no table of parts.

use rayon::prelude::*;

use super::{Faces, PolygonMesh};
use crate::error::{Error, Result};

/// Where the faces of a divided mesh come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// How often triangles were divided.
    times: u32,
    /// The face of the mesh that each triangle is of.
    faces: Vec<u32>,
    /// The corners of each triangle: vertices of the mesh.
    corners: Vec<[u32; 3]>,
}

/// A part of a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// The face of the mesh.
    pub face: u32,
    /// Three of its corners: vertices of the mesh.
    pub vertices: [u32; 3],
    /// For each corner of the part, how much of each of them.
    pub corners: [[f64; 3]; 3],
}

impl Origin {
    /// The face of the mesh that a face of the divided one is a part of.
    pub fn face(&self, face: u32) -> u32 {
        self.faces[self.triangle(face)]
    }

    fn triangle(&self, face: u32) -> usize {
        (u64::from(face) >> (2 * self.times)) as usize
    }

    /// What a face of the divided mesh is a part of.
    pub fn of(&self, face: u32) -> Part {
        let triangle = self.triangle(face);
        let mut corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for division in (0..self.times).rev() {
            let middle = |one: usize, other: usize| [0, 1, 2].map(|i| (corners[one][i] + corners[other][i]) / 2.0);
            let middles = [middle(0, 1), middle(1, 2), middle(2, 0)];
            corners = parts(corners, middles)[(face >> (2 * division)) as usize % 4];
        }
        Part { face: self.faces[triangle], vertices: self.corners[triangle], corners }
    }
}

/// The four parts of a triangle; `middles` are those of the edges after each corner.
fn parts<T: Copy>([a, b, c]: [T; 3], [ab, bc, ca]: [T; 3]) -> [[T; 3]; 4] {
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
}

/// The number of faces after so many divisions.
pub fn faces_after(triangles: u64, times: u32) -> u64 {
    4u64.checked_pow(times).map_or(u64::MAX, |parts| triangles.saturating_mul(parts))
}

/// Divides every triangle of a mesh into four, `times` times. Parts, warnings and adjustments are not taken over.
///
/// # Errors
/// The result has more corners than can be numbered.
pub fn divided(mesh: &PolygonMesh, times: u32) -> Result<(PolygonMesh, Origin)> {
    let count = faces_after(mesh.faces.triangles(), times);
    if count > u64::from(u32::MAX) / 3 {
        return Err(Error::too_large(format_args!("the divided mesh has more faces than can be numbered: {count}")));
    }
    let (mut faces, mut corners) = (Vec::new(), Vec::new());
    for face in 0..mesh.faces.len() {
        let polygon = mesh.faces.corners(face);
        for second in 1..polygon.len().saturating_sub(1) {
            faces.push(face as u32);
            corners.push([polygon[0], polygon[second], polygon[second + 1]]);
        }
    }
    let mut positions = mesh.positions.clone();
    let mut triangles = corners.clone();
    for _ in 0..times {
        triangles = four_of_each(&mut positions, &triangles);
    }
    let divided = PolygonMesh {
        format: mesh.format,
        positions,
        faces: Faces::from_triangles(triangles.into_flattened()),
        parts: Vec::new(),
        warnings: Vec::new(),
        adjusted: mesh.adjusted,
    };
    Ok((divided, Origin { times, faces, corners }))
}

/// One division; adds the middles of edges to the positions.
fn four_of_each(positions: &mut Vec<[f64; 3]>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let sides = |(triangle, &[a, b, c]): (usize, &[u32; 3])| {
        let ends = [(a, b), (b, c), (c, a)];
        [0, 1, 2].map(|side| (ends[side].0.min(ends[side].1), ends[side].0.max(ends[side].1), 3 * triangle + side))
    };
    let mut edges: Vec<(u32, u32, usize)> = triangles.iter().enumerate().flat_map(sides).collect();
    edges.par_sort_unstable();
    let mut middles = vec![[0; 3]; triangles.len()];
    for edge in edges.chunk_by(|one, other| (one.0, one.1) == (other.0, other.1)) {
        let (low, high, _) = edge[0];
        let mut number = low;
        if low != high {
            number = positions.len() as u32;
            let [one, other] = [low, high].map(|end| positions[end as usize]);
            // halves first, since the sum may not be finite
            positions.push([0, 1, 2].map(|axis| one[axis] / 2.0 + other[axis] / 2.0));
        }
        edge.iter().for_each(|&(.., side)| middles[side / 3][side % 3] = number);
    }
    triangles.iter().zip(middles).flat_map(|(&corners, middles)| parts(corners, middles)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};
    use crate::surface::Surface;

    #[test]
    fn parts_are_where_their_origin_says() {
        for (sample, times) in [(Sample::Knot, 1), (Sample::Quads, 2), (Sample::Terrain, 3), (Sample::Quads, 0)] {
            let mesh = generate(sample, 200).expect("a sample");
            let (fine, origin) = divided(&mesh, times).expect("few faces");
            assert_eq!(fine.faces.len() as u64, faces_after(mesh.faces.triangles(), times));
            assert_eq!(fine.positions[..mesh.positions.len()], mesh.positions);
            for face in 0..fine.faces.len() {
                let part = origin.of(face as u32);
                let of_face = mesh.faces.corners(part.face as usize);
                assert!(part.vertices.iter().all(|vertex| of_face.contains(vertex)));
                for (&vertex, weights) in fine.faces.corners(face).iter().zip(part.corners) {
                    for axis in 0..3 {
                        let at = |corner: usize| mesh.positions[part.vertices[corner] as usize][axis];
                        let sum: f64 = (0..3).map(|corner| weights[corner] * at(corner)).sum();
                        assert!((sum - fine.positions[vertex as usize][axis]).abs() < 1e-12);
                    }
                }
            }
        }
    }

    #[test]
    fn the_surface_stays_as_connected_as_it_was() {
        for sample in [Sample::Knot, Sample::Terrain, Sample::Parts, Sample::Quads] {
            let mesh = generate(sample, 300).expect("a sample");
            let (fine, _) = divided(&mesh, 2).expect("few faces");
            let [before, after] = [&mesh, &fine].map(|mesh| Surface::build(mesh).expect("a surface").counts);
            assert_eq!(after.components, before.components);
            assert_eq!(after.boundary_edges, 4 * before.boundary_edges);
            assert_eq!(after.non_manifold_edges, 4 * before.non_manifold_edges);
        }
    }

    #[test]
    fn more_faces_than_can_be_numbered_are_refused() {
        let mesh = generate(Sample::Knot, 300).expect("a sample");
        for times in [14, 40] {
            let error = divided(&mesh, times).expect_err("too many");
            assert!(error.message.contains("numbered"), "{error}");
        }
    }
}
