//! The labels of the faces while clusters merge.
//!
//! A merge writes one entry, what the cluster was merged into. Labels follow where they are read: those of boundary
//! faces and of their neighbours are kept up to date ([`Labels::refresh`]), and [`Labels::of`] resolves any other. So a
//! merge costs as much as the boundary of the cluster that ends, not its area. Where that would be more than a pass
//! over all labels, all are renewed at once, by all threads. Under a contraction no label is refreshed until boundaries
//! are listed.

use super::tuning::chunks::FACES;
use crate::device::FREE;
use crate::energy::Functional;
use crate::parallel;
use crate::prefetch::prefetch;
use crate::surface::DualGraph;
use crate::union_find::root;

/// Faces that a pass renews in the time that the refreshing of labels takes for a merge.
const FACES_A_MERGE: usize = 256;

/// The same for the refreshing of a face and its neighbours.
const FACES_AROUND: usize = 8;

/// One label a face, internal order.
#[derive(Debug, Default)]
pub struct Labels {
    /// A cluster, maybe one that has ended, or [`FREE`].
    raw: Vec<u32>,
    /// What each cluster was merged into; itself while it lives: a union-find forest. Empty until clusters merge.
    merged_into: Vec<u32>,
    /// The clusters that ended since all labels were those of living ones.
    ended: Vec<u32>,
    /// Whether all labels are those of living clusters.
    are_current: bool,
}

impl Labels {
    /// All faces free.
    pub fn new(faces: usize) -> Self {
        Self { raw: vec![FREE; faces], merged_into: Vec::new(), ended: Vec::new(), are_current: true }
    }

    /// Replaces all labels by those of living clusters.
    pub fn replace(&mut self, labels: &[u32]) {
        self.raw.copy_from_slice(labels);
        self.merged_into.clear();
        self.ended.clear();
        self.are_current = true;
    }

    /// The label of a boundary face or of a neighbour of one, which is up to date.
    pub fn near_boundary(&self, face: u32) -> u32 {
        debug_assert_eq!(self.raw[face as usize], self.of(face));
        self.raw[face as usize]
    }

    /// Requests the label of a face.
    #[inline]
    pub fn prefetch(&self, face: u32) {
        prefetch(&self.raw, face as usize);
    }

    /// The label of any face.
    pub fn of(&self, face: u32) -> u32 {
        let mut label = self.raw[face as usize];
        if !self.are_current && label != FREE {
            while self.merged_into[label as usize] != label {
                label = self.merged_into[label as usize];
            }
        }
        label
    }

    /// Brings the label of a face up to date, and returns it.
    pub fn refresh(&mut self, face: u32) -> u32 {
        let label = &mut self.raw[face as usize];
        if !self.are_current && *label != FREE {
            *label = root(&mut self.merged_into, *label);
        }
        *label
    }

    /// Brings the labels of some faces and of their neighbours up to date.
    pub fn refresh_around<E: Functional>(&mut self, graph: &DualGraph<E>, faces: &[u32]) {
        if FACES_AROUND * faces.len() >= self.raw.len() {
            self.renew();
        }
        if self.are_current {
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

    /// Merges the first cluster of each pair into the second, which lives. Where boundaries are listed, the caller
    /// refreshes the faces near the boundary of the first.
    pub fn merge(&mut self, clusters: usize, pairs: &[(u32, u32)]) {
        if self.merged_into.is_empty() {
            self.merged_into.extend(0..clusters as u32);
        }
        for &(from, into) in pairs {
            self.merged_into[from as usize] = into;
            self.ended.push(from);
        }
        self.are_current = false;
    }

    /// Brings all labels up to date if so many merges are worth it.
    pub fn renew_after(&mut self, merges: usize) {
        if FACES_A_MERGE * merges >= self.raw.len() {
            self.renew();
        }
    }

    /// Whether each face is a cluster of its own, of the same number.
    pub fn are_faces(&self) -> bool {
        self.are_current && (0..).zip(&self.raw).all(|(face, &label)| label == face)
    }

    /// All labels, up to date.
    pub fn all(&mut self) -> &[u32] {
        self.renew();
        &self.raw
    }

    /// Brings all labels up to date.
    fn renew(&mut self) {
        if std::mem::replace(&mut self.are_current, true) {
            return;
        }
        let merged_into = &mut self.merged_into;
        // in reverse, so that the target of a merge is resolved before it is read
        for cluster in std::mem::take(&mut self.ended).into_iter().rev() {
            merged_into[cluster as usize] = merged_into[merged_into[cluster as usize] as usize];
        }
        parallel::runs_mut(&mut self.raw, FACES, &|_, labels| {
            labels.iter_mut().filter(|label| **label != FREE).for_each(|label| *label = merged_into[*label as usize]);
        });
    }
}
