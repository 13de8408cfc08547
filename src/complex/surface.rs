//! A mesh as a cut surface: welded, in triangles, oriented, with the way back to the upload.

use glam::DVec3;

use super::half_edges::HalfEdges;
use crate::error::{Error, Result};
use crate::mesh::{Frame, PolygonMesh};
use crate::parallel;
use crate::surface::weld;

/// The 2-manifold that a mesh becomes by welding, fanning, turning and cutting.
#[derive(Debug)]
pub struct CutSurface {
    /// Its triangles and how they are connected. Corners are numbers of points.
    pub halves: HalfEdges,
    /// The distinct positions that faces use, in `frame`.
    pub points: Vec<DVec3>,
    /// A vertex of the upload at each point.
    pub vertices: Vec<u32>,
    /// The face of the upload that each triangle is from.
    pub faces: Vec<u32>,
    /// Where each triangle is in the fan of its face: the number of its second corner.
    fans: Vec<u32>,
    /// Coordinates that neither overflow nor vanish: no longer than 1.
    pub frame: Frame,
}

impl CutSurface {
    /// Welds vertices at equal positions, cuts polygons into fans, drops triangles with two equal corners, orients and
    /// cuts the others.
    pub fn new(mesh: &PolygonMesh) -> Result<Self> {
        Self::in_order(mesh, 0..mesh.faces.len() as u32)
    }

    /// The same with triangles and points in an order of the faces, each of which is there once: what is near in the
    /// order is near in memory.
    pub fn in_order(mesh: &PolygonMesh, order: impl Iterator<Item = u32>) -> Result<Self> {
        /// Three half-edges of each are numbered below 2³² − 1.
        const MOST: u64 = u32::MAX as u64 / 3 - 1;
        let count = mesh.faces.triangles();
        if count > MOST {
            return Err(Error::too_large(format_args!("the mesh has more triangles than {MOST}: {count}")));
        }
        let first = weld::first_vertices(mesh.into());
        let mut numbers = vec![weld::UNUSED; first.len()];
        let mut vertices = Vec::with_capacity(first.len());
        let room = count as usize;
        let (mut triangles, mut faces, mut fans) =
            (Vec::with_capacity(room), Vec::with_capacity(room), Vec::with_capacity(room));
        let mut corners = Vec::new();
        for face in order {
            corners.clear();
            for &vertex in mesh.faces.corners(face as usize) {
                let number = &mut numbers[first[vertex as usize] as usize];
                if *number == weld::UNUSED {
                    *number = vertices.len() as u32;
                    vertices.push(vertex);
                }
                corners.push(*number);
            }
            for second in 1..corners.len().saturating_sub(1) {
                let [a, b, c] = [corners[0], corners[second], corners[second + 1]];
                if a != b && b != c && c != a {
                    triangles.push([a, b, c]);
                    faces.push(face);
                    fans.push(second as u32);
                }
            }
        }
        drop((first, numbers));
        let frame = Frame::of(vertices.iter().map(|&vertex| mesh.positions[vertex as usize]), 0);
        let points =
            parallel::map(vertices.len(), parallel::LEAST, |at| frame.position(mesh.positions[vertices[at] as usize]));
        let halves = HalfEdges::new(triangles, points.len());
        Ok(Self { halves, points, vertices, faces, fans, frame })
    }

    /// The label of each triangle. There is one label a face of the mesh, each below `clusters`.
    pub fn labels(&self, labels: &[u32]) -> Vec<u32> {
        parallel::map(self.faces.len(), parallel::LEAST, |triangle| labels[self.faces[triangle] as usize])
    }

    /// Positions of a triangle's corners.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.halves.triangles[triangle as usize].map(|corner| self.points[corner as usize])
    }

    /// The vertices of the upload at a triangle's corners; where several are at one position, those of its face.
    pub fn upload_vertices(&self, mesh: &PolygonMesh, triangle: u32) -> [u32; 3] {
        let triangle = triangle as usize;
        let corners = mesh.faces.corners(self.faces[triangle] as usize);
        let second = self.fans[triangle] as usize;
        let (b, c) = (corners[second], corners[second + 1]);
        if self.halves.turned[triangle] { [corners[0], c, b] } else { [corners[0], b, c] }
    }

    /// The length of a half-edge.
    pub fn length(&self, half: u32) -> f64 {
        self.points[self.halves.origin(half) as usize].distance(self.points[self.halves.target(half) as usize])
    }
}

/// Refuses labels that are not one a face or not below `clusters`, and more clusters than faces. Clusters may be empty.
pub fn check_labels(mesh: &PolygonMesh, labels: &[u32], clusters: u64) -> Result<()> {
    let faces = mesh.faces.len();
    if labels.len() != faces {
        let message = format_args!("labels must be one a face, {faces} of them, not {}", labels.len());
        return Err(Error::parameter(message));
    }
    if clusters > faces as u64 {
        return Err(Error::parameter(format_args!("there are more clusters than faces, {faces}: {clusters}")));
    }
    match labels.iter().position(|&label| u64::from(label) >= clusters) {
        Some(face) => Err(Error::parameter(format_args!(
            "labels must be below the number of clusters, {clusters}; that of face {face} is {}",
            labels[face]
        ))),
        None => Ok(()),
    }
}
