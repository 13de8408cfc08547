//! Faces as shapes see them.

use crate::surface::DualGraph;
use crate::surface::samples::Samples;

/// The faces of a mesh, internal order.
#[derive(Debug, Clone, Copy)]
pub struct Faces<'a> {
    /// Their weights and neighbours.
    pub graph: &'a DualGraph,
    /// Points of them.
    pub samples: &'a Samples,
}

impl Faces<'_> {
    /// Number of faces.
    pub fn count(&self) -> usize {
        self.graph.faces()
    }

    /// The weight of a face.
    #[inline]
    pub fn weight(&self, face: u32) -> u32 {
        self.graph.weights[face as usize]
    }

    /// The samples of a face.
    #[inline]
    pub fn samples(&self, face: u32) -> &[[i32; 3]] {
        self.samples.of(face)
    }

    /// What it takes to look at some faces and their neighbours.
    pub fn looks(&self, faces: &[u32]) -> usize {
        faces.iter().map(|&face| 1 + self.graph.neighbours_of(face).len()).sum()
    }

    /// The same for all faces.
    pub fn all_looks(&self) -> usize {
        self.count() + self.graph.neighbours.items.len()
    }

    /// The unit normal of a face × 2¹⁴.
    pub fn normal(&self, face: u32) -> [i64; 3] {
        self.samples.normal(face)
    }
}

/// The faces of each of some clusters, ascending; none of clusters that are not chosen.
pub fn members(labels: &[u32], clusters: usize, is_chosen: impl Fn(u32) -> bool) -> Vec<Vec<u32>> {
    let mut members = vec![Vec::new(); clusters];
    for (face, &label) in (0..).zip(labels) {
        if is_chosen(label) {
            members[label as usize].push(face);
        }
    }
    members
}
