//! The faces of a mesh as another energy sees them.

use rayon::prelude::*;

use super::of_faces::OfFaces;
use super::{DualGraph, Items, Moves, Surface};

impl Surface {
    /// The same faces as another energy sees them; `moves` is how they move.
    pub fn seen_by<E: OfFaces>(self, moves: Moves) -> Surface<E> {
        let Self { items, counts, geometry, frame, moment_inside_faces, has_density, features } = self;
        let Items { graph, upload_face, loose, units, noun, has_features, .. } = items;
        let DualGraph { weights, neighbour_offsets, neighbours, components, .. } = graph;
        let points = geometry.par_iter().map(E::point).collect();
        let graph = DualGraph { points, weights, neighbour_offsets, neighbours, components, moves };
        let units = E::units(&frame, units.weight_exponent, units.density);
        let items = Items { loose, noun, has_features, ..Items::new(graph, upload_face, units) };
        Surface { items, counts, geometry, frame, moment_inside_faces, has_density, features }
    }
}
