//! The boundary faces of each cluster: pieces and dual edges are searched along them, and a boundary phase begins with
//! them.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::labels::Labels;
use super::tuning::chunks::{CLUSTERS, FACES};
use crate::device::FREE;
use crate::energy::Functional;
use crate::parallel;
use crate::prefetch::prefetch;
use crate::surface::DualGraph;

/// One list of boundary faces a cluster.
///
/// A list has every boundary face of its cluster, maybe twice, and maybe faces that no longer are. Those are dropped
/// when the whole list is gone through, or when it would need more memory. The labels of listed faces and of their
/// neighbours are up to date.
#[derive(Debug, Default)]
pub struct BoundaryFaces {
    faces_of_cluster: Vec<Vec<u32>>,
    /// The cluster in whose list a face counts, or [`FREE`].
    listed_in: Vec<AtomicU32>,
}

/// The list of a cluster.
pub struct ClusterList<'a> {
    pub cluster: u32,
    faces: &'a mut Vec<u32>,
    listed_in: &'a [AtomicU32],
}

impl ClusterList<'_> {
    /// Keeps the faces of the cluster for which `is_boundary` holds, each once. It is called once for each face of the
    /// cluster.
    pub fn retain(self, mut is_boundary: impl FnMut(u32) -> bool) {
        let mut kept = 0;
        for at in 0..self.faces.len() {
            let face = self.faces[at];
            let listed_in = &self.listed_in[face as usize];
            if listed_in.load(Relaxed) == self.cluster {
                // a second entry of this face is then dropped
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

impl BoundaryFaces {
    /// The boundary faces of new labels. All faces are labelled.
    pub fn collect<E: Functional>(graph: &DualGraph<E>, labels: &mut Labels, clusters: usize) -> Self {
        let all = labels.all();
        // which neighbours are in other clusters follows no pattern, so that a branch on each would be mispredicted
        let is_boundary = |&face: &u32| {
            let own = all[face as usize];
            graph.neighbours_of(face).iter().fold(false, |is, &near| is | (all[near as usize] != own))
        };
        let found = parallel::filter(all.len(), FACES, is_boundary);
        let mut listed_of_cluster = vec![0; clusters];
        found.iter().for_each(|&face| listed_of_cluster[all[face as usize] as usize] += 1);
        // twice the length, as after pruning
        let mut faces_of_cluster: Vec<Vec<u32>> =
            listed_of_cluster.into_iter().map(|listed: usize| Vec::with_capacity(2 * listed)).collect();
        let mut listed_in: Vec<AtomicU32> = (0..all.len()).map(|_| AtomicU32::new(FREE)).collect();
        for face in found {
            let own = all[face as usize];
            *listed_in[face as usize].get_mut() = own;
            faces_of_cluster[own as usize].push(face);
        }
        Self { faces_of_cluster, listed_in }
    }

    /// The boundary faces of all clusters, and maybe others; some maybe twice.
    pub fn all(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.faces_of_cluster.len() as u32).flat_map(|cluster| self.of_cluster(cluster))
    }

    /// The length of the list of a cluster.
    pub fn listed(&self, cluster: u32) -> usize {
        self.faces_of_cluster[cluster as usize].len()
    }

    /// The boundary faces of a cluster, and maybe others of its faces; some maybe twice.
    pub fn of_cluster(&self, cluster: u32) -> impl Iterator<Item = u32> + '_ {
        let faces = &self.faces_of_cluster[cluster as usize];
        faces.iter().copied().filter(move |&face| self.listed_in[face as usize].load(Relaxed) == cluster)
    }

    /// Requests what is read of the faces in the list of a cluster, except their neighbours.
    pub fn prefetch_list<E: Functional>(&self, graph: &DualGraph<E>, cluster: u32) {
        for &face in &self.faces_of_cluster[cluster as usize] {
            self.prefetch(face);
            graph.prefetch(face);
        }
    }

    /// Requests the entry of a face.
    #[inline]
    pub fn prefetch(&self, face: u32) {
        prefetch(&self.listed_in, face as usize);
    }

    /// The list of a cluster.
    pub fn list_of(&mut self, cluster: u32) -> ClusterList<'_> {
        let Self { faces_of_cluster, listed_in } = self;
        ClusterList { cluster, faces: &mut faces_of_cluster[cluster as usize], listed_in }
    }

    /// A face has moved; `labels` already have its new cluster.
    pub fn moved<E: Functional>(&mut self, graph: &DualGraph<E>, labels: &mut Labels, face: u32) {
        let to = labels.refresh(face);
        self.list(graph, labels, face, to);
        for &near in graph.neighbours_of(face) {
            let cluster = labels.near_boundary(near);
            if (cluster != to) & (cluster != FREE) & (*self.listed_in[near as usize].get_mut() != cluster) {
                self.list(graph, labels, near, cluster);
            }
        }
    }

    /// A cluster was merged into another; `labels` already say so. Calls `visit` with its boundary faces.
    pub fn merged<E: Functional>(
        &mut self,
        graph: &DualGraph<E>,
        labels: &mut Labels,
        into: u32,
        from: u32,
        mut visit: impl FnMut(&Labels, u32),
    ) {
        let of_from = std::mem::take(&mut self.faces_of_cluster[from as usize]);
        let of_into = &mut self.faces_of_cluster[into as usize];
        // half as many again for faces that are added before the next search drops those between the two
        of_into.reserve(of_from.len() + (of_into.len() + of_from.len()) / 2);
        for face in of_from {
            if *self.listed_in[face as usize].get_mut() == from {
                labels.refresh(face);
                self.list(graph, labels, face, into);
                visit(labels, face);
            }
        }
    }

    /// Calls `search` with the list of each of some clusters, ascending and each given once, in all threads. Returns
    /// the results in that order. `state` makes the scratch memory of a range of clusters.
    pub fn search<S, T: Send>(
        &mut self,
        clusters: &[u32],
        state: impl Fn() -> S + Sync,
        search: impl Fn(&mut S, ClusterList<'_>) -> T + Sync,
    ) -> Vec<T> {
        let Self { faces_of_cluster, listed_in } = self;
        let take = |&cluster: &u32| std::mem::take(&mut faces_of_cluster[cluster as usize]);
        let mut lists: Vec<Vec<u32>> = clusters.iter().map(take).collect();
        let found = parallel::runs_mut(&mut lists, CLUSTERS, &|first, lists| {
            let mut state = state();
            let lists = clusters[first..].iter().zip(lists);
            lists.map(|(&cluster, faces)| search(&mut state, ClusterList { cluster, faces, listed_in })).collect()
        });
        clusters.iter().zip(lists).for_each(|(&cluster, faces)| faces_of_cluster[cluster as usize] = faces);
        parallel::joined(found)
    }

    /// Lists a face, and brings the labels around it up to date.
    fn list<E: Functional>(&mut self, graph: &DualGraph<E>, labels: &mut Labels, face: u32, cluster: u32) {
        labels.refresh_around(graph, &[face]);
        *self.listed_in[face as usize].get_mut() = cluster;
        let faces = &self.faces_of_cluster[cluster as usize];
        if faces.len() == faces.capacity() && faces.len() >= 8 {
            self.prune(graph, labels, cluster);
        }
        self.faces_of_cluster[cluster as usize].push(face);
    }

    /// Drops the faces of a list that are no longer boundary faces of its cluster.
    pub fn prune<E: Functional>(&mut self, graph: &DualGraph<E>, labels: &Labels, cluster: u32) {
        let is_boundary = |face| graph.neighbours_of(face).iter().any(|&near| labels.of(near) != cluster);
        self.list_of(cluster).retain(is_boundary);
        let faces = &mut self.faces_of_cluster[cluster as usize];
        // twice the length: fewer pruning passes, but no more memory than that
        let room = 2 * faces.len();
        if faces.capacity() < room { faces.reserve_exact(faces.len()) } else { faces.shrink_to(room) }
    }
}
