//! Pieces of clusters: those that were cut off, and those that a move would cut off.

use std::cmp::Reverse;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::Partition;
use super::detour::surely_stays_connected;
use super::tuning::chunks::CLUSTERS;
use crate::surface::DualGraph;

/// Scratch memory of walks: a number for each face, of any value. One thread at a time walks over the faces of a
/// cluster.
pub type Places = [AtomicU32];

/// A walk over the pieces of a cluster, one after the other.
///
/// A face was visited if it is the one at the place that `places` has for it. So nothing is cleared between walks (the
/// sparse set of Briggs & Torczon 1993).
pub struct Walk<'a> {
    /// The visited faces, piece by piece.
    faces: Vec<u32>,
    places: &'a Places,
}

impl<'a> Walk<'a> {
    /// Before any walk.
    pub fn new(places: &'a Places) -> Self {
        Self { faces: Vec::new(), places }
    }

    /// Visits a face unless it was visited before.
    #[inline]
    fn visit(&mut self, face: u32) {
        let place = &self.places[face as usize];
        if self.faces.get(place.load(Relaxed) as usize) != Some(&face) {
            place.store(self.faces.len() as u32, Relaxed);
            self.faces.push(face);
        }
    }

    /// Walks over the faces of a cluster, given at least one of each piece. Returns where those of each piece are in
    /// `self.faces`.
    fn pieces(
        &mut self,
        graph: &DualGraph,
        from: impl Iterator<Item = u32>,
        is_own: impl Fn(u32) -> bool,
    ) -> Vec<Range<usize>> {
        self.faces.clear();
        let mut pieces = Vec::new();
        for start in from {
            let first = self.faces.len();
            self.visit(start);
            let mut at = first;
            while let Some(&face) = self.faces.get(at) {
                graph.neighbours_of(face).iter().filter(|&&near| is_own(near)).for_each(|&near| self.visit(near));
                at += 1;
            }
            if at > first {
                pieces.push(first..at);
            }
        }
        pieces
    }

    /// Whether a connected cluster stays connected when it loses one of its faces.
    pub fn stays_connected(&mut self, Partition { graph, labels, .. }: &Partition<'_>, face: u32) -> bool {
        let cluster = labels.of(face);
        let is_own = |near: u32| near != face && labels.of(near) == cluster;
        let beside = graph.neighbours_of(face).iter().copied().filter(|&near| is_own(near));
        surely_stays_connected(graph, face, is_own) || self.pieces(graph, beside, is_own).len() == 1
    }
}

/// The faces outside the piece with the most faces (of equally large ones, that with the smallest face) of each of the
/// given clusters, each given once, sorted.
pub fn cut_off(partition: &Partition<'_>, of_clusters: &[u32], places: &Places) -> Vec<u32> {
    let Partition { graph, labels, boundary, .. } = partition;
    let of_chunk = |of_clusters: &[u32]| {
        let (mut cut_off, mut walk) = (Vec::new(), Walk::new(places));
        for &cluster in of_clusters {
            // of several pieces, each has a boundary face
            let pieces = walk.pieces(graph, boundary.of_cluster(cluster), |face| labels.of(face) == cluster);
            let mut pieces: Vec<&[u32]> = pieces.into_iter().map(|piece| &walk.faces[piece]).collect();
            if pieces.len() > 1 {
                pieces.sort_by_key(|piece| (Reverse(piece.len()), piece.iter().min().copied()));
                pieces[1..].iter().for_each(|piece| cut_off.extend_from_slice(piece));
            }
        }
        cut_off
    };
    let mut cut_off: Vec<u32> = of_clusters.par_chunks(CLUSTERS).flat_map_iter(of_chunk).collect();
    cut_off.sort_unstable();
    cut_off
}
