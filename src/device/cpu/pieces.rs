//! Pieces of clusters that were cut off.

use std::cmp::Reverse;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::Partition;
use super::tuning::chunks::CLUSTERS;
use crate::energy::Functional;
use crate::parallel;
use crate::surface::DualGraph;
use crate::union_find::root;

/// Scratch memory of walks: a number for each face, of any value. One thread at a time walks over the faces of a
/// cluster.
pub type Places = [AtomicU32];

/// A breadth-first walk over a cluster from several of its faces at once. Each begins a set; sets that meet are joined.
/// When one is left, the faces that were not visited belong to it, and the walk ends.
///
/// A face was visited if it is the one at the place that `places` has for it. So nothing is cleared between walks (the
/// sparse set of Briggs & Torczon 1993).
pub struct Walk<'a> {
    /// The visited faces, in order.
    faces: Vec<u32>,
    places: &'a Places,
    /// The set that each visited face was put in.
    set_of_face: Vec<u32>,
    /// A union-find forest of the sets.
    sets: Vec<u32>,
}

impl<'a> Walk<'a> {
    /// Before any walk.
    pub fn new(places: &'a Places) -> Self {
        Self { faces: Vec::new(), places, set_of_face: Vec::new(), sets: Vec::new() }
    }

    /// The place of a face in the walk, if it was visited.
    #[inline]
    fn place(&self, face: u32) -> Option<usize> {
        let place = self.places[face as usize].load(Relaxed) as usize;
        (self.faces.get(place) == Some(&face)).then_some(place)
    }

    /// Visits a face for the first time.
    #[inline]
    fn visit(&mut self, face: u32, set: u32) {
        self.places[face as usize].store(self.faces.len() as u32, Relaxed);
        self.faces.push(face);
        self.set_of_face.push(set);
    }

    /// Walks from faces of a cluster, at least one of each piece. Returns how many pieces there are; if
    /// several, all faces of the cluster were visited.
    fn pieces<E: Functional>(
        &mut self,
        graph: &DualGraph<E>,
        from: impl Iterator<Item = u32>,
        is_own: impl Fn(u32) -> bool,
    ) -> usize {
        self.faces.clear();
        self.set_of_face.clear();
        for face in from {
            if self.place(face).is_none() {
                self.visit(face, self.faces.len() as u32);
            }
        }
        let mut pieces = self.faces.len();
        self.sets.clear();
        self.sets.extend(0..pieces as u32);
        let mut at = 0;
        while pieces > 1 && at < self.faces.len() {
            let set = root(&mut self.sets, self.set_of_face[at]);
            for &near in graph.neighbours_of(self.faces[at]) {
                if let Some(place) = self.place(near) {
                    let other = root(&mut self.sets, self.set_of_face[place]);
                    pieces -= usize::from(other != set);
                    self.sets[other as usize] = set;
                } else if is_own(near) {
                    self.visit(near, set);
                }
            }
            at += 1;
        }
        pieces
    }

    /// The faces outside the largest piece (of equally large ones, that with the smallest face), if the walk found
    /// several.
    fn outside_largest(&mut self) -> impl Iterator<Item = u32> {
        let set_of_face: Vec<u32> = self.set_of_face.iter().map(|&set| root(&mut self.sets, set)).collect();
        let mut ranks = vec![(0, Reverse(u32::MAX)); self.sets.len()];
        for (&face, &set) in self.faces.iter().zip(&set_of_face) {
            let (faces, smallest) = &mut ranks[set as usize];
            (*faces, *smallest) = (*faces + 1, (*smallest).max(Reverse(face)));
        }
        let largest = (0..).zip(ranks).max_by_key(|&(_, rank)| rank).map(|(set, _): (u32, _)| set);
        self.faces.iter().copied().zip(set_of_face).filter(move |&(_, set)| Some(set) != largest).map(|(face, _)| face)
    }
}

/// The faces outside the piece with the most faces (of equally large ones, that with the smallest face) of each of the
/// given clusters, each given once, sorted.
pub fn cut_off<E: Functional>(partition: &Partition<'_, E>, of_clusters: &[u32], places: &Places) -> Vec<u32> {
    let Partition { graph, labels, boundary, .. } = partition;
    let mut cut_off = parallel::list(of_clusters.len(), CLUSTERS, &|range, cut_off| {
        let mut walk = Walk::new(places);
        for &cluster in &of_clusters[range] {
            // of several pieces, each has a boundary face
            let starts = boundary.of_cluster(cluster);
            if walk.pieces(graph, starts, |face| labels.of(face) == cluster) > 1 {
                cut_off.extend(walk.outside_largest());
            }
        }
    });
    cut_off.sort_unstable();
    cut_off
}
