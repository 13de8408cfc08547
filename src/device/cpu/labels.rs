//! The labels of the faces, and what became of clusters that merged.
//!
//! A merge relabels only the faces that others can see: the boundary faces of the cluster that ends, and their
//! neighbours. What lies deeper keeps the old name, and [`Labels::of`] looks up what became of it. So a merge costs as
//! much as the border of the smaller cluster, not its area. Where a contraction stands for the faces nobody looks at borders,
//! and all of them keep their old names until there is a frontier.

use crate::device::FREE;
use crate::surface::DualGraph;

/// One label a face, internal order.
#[derive(Debug)]
pub struct Labels {
    /// A cluster or one that became part of it, or [`FREE`].
    raw: Vec<u32>,
    /// What each cluster became part of; itself while it lives. Empty until clusters merge.
    merged_into: Vec<u32>,
}

impl Labels {
    /// All faces free.
    pub fn new(faces: usize) -> Self {
        Self { raw: vec![FREE; faces], merged_into: Vec::new() }
    }

    /// Replaces all labels by those of living clusters.
    pub fn replace(&mut self, labels: &[u32]) {
        self.raw.copy_from_slice(labels);
        self.merged_into.clear();
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        self.raw.len()
    }

    /// The label of a face that lies on a boundary or beside one that does: those are kept up to date.
    pub fn near_boundary(&self, face: u32) -> u32 {
        debug_assert_eq!(self.raw[face as usize], self.of(face));
        self.raw[face as usize]
    }

    /// The label of any face.
    pub fn of(&self, face: u32) -> u32 {
        let mut label = self.raw[face as usize];
        if !self.merged_into.is_empty() && label != FREE {
            while self.merged_into[label as usize] != label {
                label = self.merged_into[label as usize];
            }
        }
        label
    }

    /// Brings the label of a face up to date, and returns it.
    pub fn refresh(&mut self, face: u32) -> u32 {
        let old = self.raw[face as usize];
        if self.merged_into.is_empty() || old == FREE || self.merged_into[old as usize] == old {
            return old;
        }
        let label = self.of(face);
        // shorten the path for all who come after
        let mut old = std::mem::replace(&mut self.raw[face as usize], label);
        while old != label && old != FREE {
            old = std::mem::replace(&mut self.merged_into[old as usize], label);
        }
        label
    }

    /// Brings the labels of some faces and of those beside them up to date.
    pub fn refresh_around(&mut self, graph: &DualGraph, faces: &[u32]) {
        if self.merged_into.is_empty() {
            return;
        }
        for &face in faces {
            self.refresh(face);
            for &near in graph.neighbours_of(face) {
                self.refresh(near);
            }
        }
    }

    /// Gives a face to a living cluster, or frees it.
    pub fn set(&mut self, face: u32, label: u32) {
        self.raw[face as usize] = label;
    }

    /// Lets a cluster of `clusters` become part of another. Where there is a frontier, the faces near its boundary must be
    /// refreshed.
    pub fn merge(&mut self, clusters: usize, into: u32, from: u32) {
        if self.merged_into.is_empty() {
            self.merged_into.extend(0..clusters as u32);
        }
        self.merged_into[from as usize] = into;
    }

    /// All labels, up to date.
    pub fn all(&mut self) -> &[u32] {
        if !self.merged_into.is_empty() {
            for face in 0..self.raw.len() as u32 {
                self.refresh(face);
            }
        }
        &self.raw
    }
}
