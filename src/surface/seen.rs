//! The faces of a mesh as energies of normals and of shapes see them.

use glam::DVec3;

use super::lattice::PIECE;
use super::of_faces::OfFaces;
use super::{DualGraph, Items, Moves, Surface};
use crate::mesh::MeshView;
use crate::parallel;

impl Surface {
    /// The same faces with their normals; the mesh is the one that it was built from.
    pub fn with_normals(mut self, mesh: MeshView<'_>) -> Self {
        let faces = &self.items.upload_face;
        let normal = |face: usize| self.frame.vector_area(mesh, faces[face] as usize).normalize_or_zero();
        self.normals = parallel::map(faces.len(), PIECE, normal);
        self
    }

    /// The same faces as another energy sees them; `moves` is how they move.
    pub fn seen_by<E: OfFaces>(self, moves: Moves) -> Surface<E> {
        let point = |face: usize| E::point(&self.geometry[face], self.normal(face));
        let points = parallel::map(self.geometry.len(), PIECE, point);
        let Self { items, counts, geometry, normals, frame, moment_inside_faces, has_density, features } = self;
        let Items { graph, upload_face, loose, units, noun, has_features, .. } = items;
        let DualGraph { weights, neighbours, components, .. } = graph;
        let graph = DualGraph { points, weights, neighbours, components, moves };
        let units = E::units(&frame, units.weight_exponent, units.density);
        let items = Items { loose, noun, has_features, ..Items::new(graph, upload_face, units) };
        Surface { items, counts, geometry, normals, frame, moment_inside_faces, has_density, features }
    }
}

impl<E: OfFaces> Surface<E> {
    /// The unit normal of a face; 0 without area, and where there are no normals.
    pub(super) fn normal(&self, face: usize) -> DVec3 {
        self.normals.get(face).copied().unwrap_or_default()
    }
}
