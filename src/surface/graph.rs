//! The dual graph of a surface on the integer lattice: all that algorithms and devices see of a mesh.

use super::components::Component;
use super::rows::Rows;
use crate::energy::{Energy, Functional, Item, Sums};
use crate::prefetch::prefetch;

/// Faces as nodes with a place and a weight, shared edges as edges.
///
/// A [`super::Surface`] has one whose nodes are its faces; [`contracted`](Self::contracted) makes smaller ones whose
/// nodes are groups of faces. Everything is in internal order.
#[derive(Debug, Clone)]
pub struct DualGraph<E: Functional = Energy> {
    /// Face centroids on the lattice, |coordinate| < 2²⁷.
    pub points: Vec<E::Point>,
    /// Face weights, at least 1. A component's weights sum to less than 2³⁴.
    pub weights: Vec<u32>,
    /// Faces that share an edge with each face. Symmetric; a face may be listed twice, never itself.
    pub neighbours: Rows,
    /// The connected components, each a run of faces.
    pub components: Vec<Component>,
    /// How faces move.
    pub moves: Moves,
}

/// How faces move in the phases.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Moves {
    /// All at once, and a repair joins what they cut: neighbours are near each other, so that few clusters are cut.
    #[default]
    Free,
    /// Each cluster stays connected, for neighbours may be far from each other. Free moves cut such clusters in so many
    /// pieces that repairs end above the start.
    Connected,
}

/// Faces from which on prefetching pays in clusterings (`benches/results/2026-11-22-two-cores-xeon/ahead.md`). Smaller
/// graphs lie in the caches.
const OUTGROWS_CACHES: usize = 1 << 18;

#[cfg(test)]
thread_local! {
    /// Neighbours that this thread has looked at: tests of bounds on work.
    pub static LOOKS: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

impl<E: Functional> DualGraph<E> {
    /// Whether reads all over the graph are worth [prefetching](crate::prefetch).
    pub(crate) fn outgrows_caches(&self) -> bool {
        self.faces() >= OUTGROWS_CACHES
    }

    /// Requests what the graph has of a face, except its neighbours.
    #[inline]
    pub(crate) fn prefetch(&self, face: u32) {
        let face = face as usize;
        prefetch(&self.points, face);
        prefetch(&self.weights, face);
        prefetch(&self.neighbours.offsets, face);
    }

    /// Requests the neighbours of a face.
    #[inline]
    pub(crate) fn prefetch_neighbours(&self, face: u32) {
        prefetch(&self.neighbours.items, self.neighbours.offsets[face as usize] as usize);
    }

    /// What the energy sees of a face.
    #[inline]
    pub fn face(&self, face: usize) -> Item<E::Point> {
        Item { point: self.points[face], weight: self.weights[face] }
    }

    /// The sums over some faces.
    #[inline]
    pub fn sums_over(&self, faces: impl IntoIterator<Item = u32>) -> E::Sums {
        let mut sums = E::Sums::default();
        faces.into_iter().for_each(|face| sums.add_face(self.face(face as usize), 1));
        sums
    }

    /// Number of faces.
    pub fn faces(&self) -> usize {
        self.weights.len()
    }

    /// The faces that share an edge with `face`.
    pub fn neighbours_of(&self, face: u32) -> &[u32] {
        let row = self.neighbours.of(face);
        #[cfg(test)]
        LOOKS.with(|looks| looks.set(looks.get() + row.len() as u64));
        row
    }

    /// The component of each face.
    pub fn component_of_face(&self) -> Vec<u32> {
        let mut component_of_face = vec![0; self.faces()];
        for (component, run) in self.components.iter().enumerate() {
            component_of_face[run.range()].fill(component as u32);
        }
        component_of_face
    }

    /// The component that each of so many clusters lies in.
    pub fn component_of_cluster(&self, labels: &[u32], clusters: usize) -> Vec<u32> {
        let mut component_of_cluster = vec![0; clusters];
        for (component, run) in (0..).zip(&self.components) {
            labels[run.range()].iter().for_each(|&label| component_of_cluster[label as usize] = component);
        }
        component_of_cluster
    }
}
