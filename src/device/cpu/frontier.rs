//! The boundary faces of each cluster: where pieces and dual edges are looked for.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::labels::Labels;
use super::sieve::Sieve;
use crate::device::FREE;
use crate::prefetch::prefetch;
use crate::surface::DualGraph;

/// Faces that a thread looks at to find those on boundaries.
const PIECE: usize = 1 << 13;

/// One list of boundary faces a cluster.
///
/// A list holds every boundary face of its cluster, and maybe faces that no longer are; those go when somebody looks at all of it
/// anyway, or when it would grow. The labels of listed faces and of their neighbours are up to date.
#[derive(Debug, Default)]
pub struct Frontier {
    faces_of_cluster: Vec<Vec<u32>>,
    /// The cluster in whose list a face is, or [`FREE`].
    listed_in: Vec<AtomicU32>,
}

/// The list of a cluster.
pub struct List<'a> {
    pub cluster: u32,
    faces: &'a mut Vec<u32>,
    listed_in: &'a [AtomicU32],
}

impl List<'_> {
    /// Drops the faces that no longer belong there: asks of each that the cluster has, once, whether it lies on the boundary.
    pub fn retain(self, mut is_boundary: impl FnMut(u32) -> bool) {
        let mut kept = 0;
        for at in 0..self.faces.len() {
            let face = self.faces[at];
            let listed_in = &self.listed_in[face as usize];
            if listed_in.load(Relaxed) == self.cluster {
                // so that it goes where it is listed a second time
                listed_in.store(FREE, Relaxed);
                self.faces[kept] = face;
                kept += usize::from(is_boundary(face));
            }
        }
        self.faces.truncate(kept);
        for &face in self.faces.iter() {
            self.listed_in[face as usize].store(self.cluster, Relaxed);
        }
    }
}

impl Frontier {
    /// The frontier of new labels; all faces labelled.
    pub fn collect(graph: &DualGraph, labels: &mut Labels, clusters: usize) -> Self {
        let all = labels.all();
        let is_boundary = |face: u32| {
            let own = all[face as usize];
            graph.neighbours_of(face).iter().fold(false, |is, &near| is | (all[near as usize] != own))
        };
        let pieces = all.len().div_ceil(PIECE);
        let found = (0..pieces).into_par_iter().map_init(Sieve::default, |found, piece| {
            let faces = (piece * PIECE) as u32..((piece + 1) * PIECE).min(all.len()) as u32;
            found.clear();
            found.add(faces.len(), faces, is_boundary);
            // they lie beside each other until all are found
            found.kept().to_vec()
        });
        let found: Vec<Vec<u32>> = found.collect();
        let mut listed_of_cluster = vec![0; clusters];
        found.iter().flatten().for_each(|&face| listed_of_cluster[all[face as usize] as usize] += 1);
        // as much room again, as when a list is pruned
        let mut faces_of_cluster: Vec<Vec<u32>> =
            listed_of_cluster.into_iter().map(|listed: usize| Vec::with_capacity(2 * listed)).collect();
        let mut listed_in: Vec<AtomicU32> = (0..all.len()).map(|_| AtomicU32::new(FREE)).collect();
        for face in found.into_iter().flatten() {
            let own = all[face as usize];
            *listed_in[face as usize].get_mut() = own;
            faces_of_cluster[own as usize].push(face);
        }
        Self { faces_of_cluster, listed_in }
    }

    /// The boundary faces of all clusters, and maybe some more; some maybe twice.
    pub fn all(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.faces_of_cluster.len() as u32).flat_map(|cluster| self.boundary_of(cluster))
    }

    /// How many faces the list of a cluster has.
    pub fn listed(&self, cluster: u32) -> usize {
        self.faces_of_cluster[cluster as usize].len()
    }

    /// The boundary faces of a cluster, and maybe some more of its faces; some maybe twice.
    pub fn boundary_of(&self, cluster: u32) -> impl Iterator<Item = u32> + '_ {
        let faces = &self.faces_of_cluster[cluster as usize];
        faces.iter().copied().filter(move |&face| self.listed_in[face as usize].load(Relaxed) == cluster)
    }

    /// Asks for where a face is listed.
    #[inline]
    pub fn prefetch(&self, face: u32) {
        prefetch(&self.listed_in, face as usize);
    }

    /// The list of a cluster, to be looked at.
    pub fn list_of(&mut self, cluster: u32) -> List<'_> {
        let Self { faces_of_cluster, listed_in } = self;
        List { cluster, faces: &mut faces_of_cluster[cluster as usize], listed_in }
    }

    /// Keeps the lists in step with a face that has moved; `labels` already say so.
    pub fn moved(&mut self, graph: &DualGraph, labels: &mut Labels, face: u32) {
        let to = labels.refresh(face);
        self.list(graph, labels, face, to);
        for &near in graph.neighbours_of(face) {
            let cluster = labels.near_boundary(near);
            if (cluster != to) & (cluster != FREE) & (*self.listed_in[near as usize].get_mut() != cluster) {
                self.list(graph, labels, near, cluster);
            }
        }
    }

    /// Keeps the lists in step with a cluster that became part of another; `labels` already say so. Calls `visit` with its
    /// boundary faces.
    pub fn merged(
        &mut self,
        graph: &DualGraph,
        labels: &mut Labels,
        into: u32,
        from: u32,
        mut visit: impl FnMut(&Labels, u32),
    ) {
        let of_from = std::mem::take(&mut self.faces_of_cluster[from as usize]);
        let of_into = &mut self.faces_of_cluster[into as usize];
        // and half of that for faces that come: who looks for dual edges next will drop those between the two
        of_into.reserve(of_from.len() + (of_into.len() + of_from.len()) / 2);
        for face in of_from {
            if *self.listed_in[face as usize].get_mut() == from {
                labels.refresh(face);
                self.list(graph, labels, face, into);
                visit(labels, face);
            }
        }
    }

    /// Calls `look` with the lists of some clusters, each given once, ascending; a thread looks at `piece` of them or more. Says what it
    /// says of each.
    pub fn look_at<S, T: Send>(
        &mut self,
        clusters: &[u32],
        piece: usize,
        state: impl Fn() -> S + Sync + Send,
        look: impl Fn(&mut S, List<'_>) -> T + Sync + Send,
    ) -> Vec<T> {
        let Self { faces_of_cluster, listed_in } = self;
        let take = |&cluster: &u32| std::mem::take(&mut faces_of_cluster[cluster as usize]);
        let mut lists: Vec<Vec<u32>> = clusters.iter().map(take).collect();
        let seen = clusters
            .par_iter()
            .zip(&mut lists)
            .with_min_len(piece)
            .map_init(state, |state, (&cluster, faces)| look(state, List { cluster, faces, listed_in }));
        let seen = seen.collect();
        clusters.iter().zip(lists).for_each(|(&cluster, faces)| faces_of_cluster[cluster as usize] = faces);
        seen
    }

    /// Lists a face, and lets the labels around it be up to date.
    fn list(&mut self, graph: &DualGraph, labels: &mut Labels, face: u32, cluster: u32) {
        labels.refresh_around(graph, &[face]);
        *self.listed_in[face as usize].get_mut() = cluster;
        let faces = &self.faces_of_cluster[cluster as usize];
        if faces.len() == faces.capacity() && faces.len() >= 8 {
            self.prune(graph, labels, cluster);
        }
        self.faces_of_cluster[cluster as usize].push(face);
    }

    /// Drops the faces of a list that no longer belong there.
    pub fn prune(&mut self, graph: &DualGraph, labels: &Labels, cluster: u32) {
        let is_boundary = |face| graph.neighbours_of(face).iter().any(|&near| labels.of(near) != cluster);
        self.list_of(cluster).retain(is_boundary);
        let faces = &mut self.faces_of_cluster[cluster as usize];
        // as much room again, so that the next time is far away; not more, so that reading does not take longer than it must
        let room = 2 * faces.len();
        if faces.capacity() < room { faces.reserve_exact(faces.len()) } else { faces.shrink_to(room) }
    }
}
