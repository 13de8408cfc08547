//! Corners of the faces, in f64.

use glam::DVec3;

use super::Surface;
use super::weld::{UNUSED, weld};
use crate::mesh::{Faces, MeshView};

/// Corners of all faces, internal order; corners at one place are one vertex.
#[derive(Debug, Clone)]
pub struct Corners {
    /// The faces; their corners are numbers of vertices.
    pub faces: Faces,
    positions: Vec<DVec3>,
}

impl Corners {
    /// The vertices of a face, in order around it.
    #[inline]
    pub fn of(&self, face: u32) -> &[u32] {
        self.faces.corners(face as usize)
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.positions.len()
    }

    /// The place of a vertex, lattice units.
    #[inline]
    pub fn position(&self, vertex: u32) -> DVec3 {
        self.positions[vertex as usize]
    }

    /// The places of the corners of a face.
    pub fn positions_of(&self, face: u32) -> impl Iterator<Item = DVec3> + Clone {
        self.of(face).iter().map(|&vertex| self.position(vertex))
    }

    /// The pairs of vertices that the edges of a face connect, in order around it.
    pub fn edges_of(&self, face: u32) -> impl Iterator<Item = [u32; 2]> {
        let corners = self.of(face);
        (0..corners.len()).map(|at| [corners[at], corners[(at + 1) % corners.len()]])
    }
}

impl Surface {
    /// Corners of the faces of the mesh that this surface was built of.
    pub fn corners(&self, mesh: MeshView<'_>) -> Corners {
        let (weld, vertex_of_corner) = weld(mesh);
        let mut positions = vec![DVec3::ZERO; weld.vertices as usize];
        for (position, &vertex) in mesh.positions.iter().zip(&weld.position_of_vertex) {
            if vertex != UNUSED {
                positions[vertex as usize] = self.frame.position(position);
            }
        }
        let corners =
            self.items.upload_face.iter().map(|&face| &vertex_of_corner[mesh.faces.corner_range(face as usize)]);
        let faces = match mesh.faces.are_triangles() {
            true => Faces::from_triangles(corners.flatten().copied().collect()),
            false => {
                let mut faces = Faces::with_capacity(self.items.upload_face.len());
                corners.for_each(|corners| faces.push(corners));
                faces
            }
        };
        Corners { faces, positions }
    }
}
