//! The labels of the faces, and what became of clusters that merged.
//!
//! A merge relabels only the faces that others can see: the boundary faces of the cluster that ends, and their
//! neighbours. What lies deeper keeps the old name, and [`Labels::of`] looks up what became of it. So a merge costs as
//! much as the border of the smaller cluster, not its area. Where that would be more than a pass through memory, all labels
//! are brought up to date at once, by all threads. Where a contraction stands for the faces nobody looks at borders, and all
//! of them keep their old names until there is a frontier.

use rayon::prelude::*;

use crate::device::FREE;
use crate::prefetch::prefetch;
use crate::surface::DualGraph;

/// A pass over so many faces costs less than what a merge otherwise does.
const FACES_A_MERGE: usize = 256;

/// The same for a face and those beside it that are brought up to date.
const FACES_AROUND: usize = 8;

/// Faces that a thread relabels at a time.
const PIECE: usize = 1 << 14;

/// One label a face, internal order.
#[derive(Debug)]
pub struct Labels {
    /// A cluster or one that became part of it, or [`FREE`].
    raw: Vec<u32>,
    /// What each cluster became part of; itself while it lives. Empty until clusters merge.
    merged_into: Vec<u32>,
    /// The clusters that ended since all labels were those of living ones.
    ended: Vec<u32>,
    /// Whether all labels are those of living clusters.
    are_new: bool,
}

impl Labels {
    /// All faces free.
    pub fn new(faces: usize) -> Self {
        Self { raw: vec![FREE; faces], merged_into: Vec::new(), ended: Vec::new(), are_new: true }
    }

    /// Replaces all labels by those of living clusters.
    pub fn replace(&mut self, labels: &[u32]) {
        self.raw.copy_from_slice(labels);
        self.merged_into.clear();
        self.ended.clear();
        self.are_new = true;
    }

    /// The label of a face that lies on a boundary or beside one that does: those are kept up to date.
    pub fn near_boundary(&self, face: u32) -> u32 {
        debug_assert_eq!(self.raw[face as usize], self.of(face));
        self.raw[face as usize]
    }

    /// Asks for the label of a face.
    #[inline]
    pub fn prefetch(&self, face: u32) {
        prefetch(&self.raw, face as usize);
    }

    /// The label of any face.
    pub fn of(&self, face: u32) -> u32 {
        let mut label = self.raw[face as usize];
        if !self.are_new && label != FREE {
            while self.merged_into[label as usize] != label {
                label = self.merged_into[label as usize];
            }
        }
        label
    }

    /// Brings the label of a face up to date, and returns it.
    pub fn refresh(&mut self, face: u32) -> u32 {
        let old = self.raw[face as usize];
        if self.are_new || old == FREE || self.merged_into[old as usize] == old {
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
        if FACES_AROUND * faces.len() >= self.raw.len() {
            self.renew();
        }
        if self.are_new {
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

    /// Lets clusters of `clusters` become part of others, each the first of its pair of the second, which lives. Where there is a
    /// frontier, the faces near the boundaries of the former must be refreshed.
    pub fn merge(&mut self, clusters: usize, pairs: &[(u32, u32)]) {
        if self.merged_into.is_empty() {
            self.merged_into.extend(0..clusters as u32);
        }
        for &(from, into) in pairs {
            self.merged_into[from as usize] = into;
            self.ended.push(from);
        }
        self.are_new = false;
    }

    /// Brings all labels up to date, if so many merges are worth that.
    pub fn renew_after(&mut self, merges: usize) {
        if FACES_A_MERGE * merges >= self.raw.len() {
            self.renew();
        }
    }

    /// All labels, up to date.
    pub fn all(&mut self) -> &[u32] {
        self.renew();
        &self.raw
    }

    /// Brings all labels up to date.
    fn renew(&mut self) {
        if std::mem::replace(&mut self.are_new, true) {
            return;
        }
        let merged_into = &mut self.merged_into;
        // what a cluster merged into may have merged since: the last comes first
        for cluster in std::mem::take(&mut self.ended).into_iter().rev() {
            merged_into[cluster as usize] = merged_into[merged_into[cluster as usize] as usize];
        }
        self.raw.par_chunks_mut(PIECE).for_each(|labels| {
            labels.iter_mut().filter(|label| **label != FREE).for_each(|label| *label = merged_into[*label as usize]);
        });
    }
}
