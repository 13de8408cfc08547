//! The boundary faces of each cluster, and which faces need another look.
//!
//! A face decides by its own and its neighbours' clusters, so it needs another look only when one of those gained or
//! lost a face; all others would decide as they did before. Faces that can decide anything lie on a boundary, so the
//! faces to look at are found from the boundary lists of the clusters that changed, at a cost in proportion to those.

use super::labels::Labels;
use crate::device::FREE;
use crate::surface::DualGraph;

/// One list of boundary faces a cluster.
///
/// A list holds every boundary face of its cluster, and maybe faces that no longer are; those go when it is next read.
/// The labels of listed faces and of their neighbours are up to date.
#[derive(Debug, Default)]
pub struct Frontier {
    faces_of_cluster: Vec<Vec<u32>>,
    /// The cluster in whose list a face is, or [`FREE`].
    listed_in: Vec<u32>,
    /// The last reading in which a face was due.
    due_in: Vec<u32>,
    reading: u32,
    due: Vec<u32>,
}

impl Frontier {
    /// The frontier of new labels; all faces labelled.
    pub fn collect(graph: &DualGraph, labels: &mut Labels, clusters: usize) -> Self {
        let faces = labels.len();
        let mut frontier = Self {
            faces_of_cluster: vec![Vec::new(); clusters],
            listed_in: vec![FREE; faces],
            due_in: vec![0; faces],
            reading: 0,
            due: Vec::new(),
        };
        let all = labels.all();
        for face in 0..faces as u32 {
            let own = all[face as usize];
            if graph.neighbours_of(face).iter().any(|&near| all[near as usize] != own) {
                frontier.listed_in[face as usize] = own;
                frontier.faces_of_cluster[own as usize].push(face);
            }
        }
        frontier
    }

    /// The faces listed for the changed clusters and the faces beside them, each once. A face of a changed cluster or
    /// with a neighbour in one that is not among them lies on no boundary and did not before.
    ///
    /// `also` are boundary faces that are due anyway.
    pub fn due(&mut self, graph: &DualGraph, labels: &Labels, changed: &[u32], also: &[u32]) -> &[u32] {
        self.reading += 1;
        self.due.clear();
        also.iter().for_each(|&face| self.mark(face));
        for &cluster in changed {
            let mut faces = std::mem::take(&mut self.faces_of_cluster[cluster as usize]);
            faces.retain(|&face| {
                if labels.near_boundary(face) != cluster {
                    return false;
                }
                let mut is_boundary = false;
                for &near in graph.neighbours_of(face) {
                    if labels.near_boundary(near) != cluster {
                        is_boundary = true;
                        self.mark(near);
                    }
                }
                self.mark(face);
                if !is_boundary {
                    self.listed_in[face as usize] = FREE;
                }
                is_boundary
            });
            self.faces_of_cluster[cluster as usize] = faces;
        }
        &self.due
    }

    /// The boundary faces of a cluster, and maybe some more of its faces.
    pub fn boundary_of<'a>(&'a self, labels: &'a Labels, cluster: u32) -> impl Iterator<Item = u32> + 'a {
        let faces = &self.faces_of_cluster[cluster as usize];
        faces.iter().copied().filter(move |&face| labels.near_boundary(face) == cluster)
    }

    /// Keeps the lists in step with a face that has moved; `labels` already say so.
    pub fn moved(&mut self, graph: &DualGraph, labels: &mut Labels, face: u32) {
        let to = labels.refresh(face);
        self.list(graph, labels, face, to);
        for &near in graph.neighbours_of(face) {
            let cluster = labels.near_boundary(near);
            if cluster != to && cluster != FREE && self.listed_in[near as usize] != cluster {
                self.list(graph, labels, near, cluster);
            }
        }
    }

    /// Keeps the lists in step with a cluster that became part of another; `labels` already say so.
    pub fn merged(&mut self, graph: &DualGraph, labels: &mut Labels, into: u32, from: u32) {
        for face in std::mem::take(&mut self.faces_of_cluster[from as usize]) {
            if self.listed_in[face as usize] == from {
                labels.refresh(face);
                self.list(graph, labels, face, into);
            }
        }
    }

    /// Lists a face, and lets the labels around it be up to date.
    fn list(&mut self, graph: &DualGraph, labels: &mut Labels, face: u32, cluster: u32) {
        for &near in graph.neighbours_of(face) {
            labels.refresh(near);
        }
        self.listed_in[face as usize] = cluster;
        self.faces_of_cluster[cluster as usize].push(face);
    }

    fn mark(&mut self, face: u32) {
        if std::mem::replace(&mut self.due_in[face as usize], self.reading) != self.reading {
            self.due.push(face);
        }
    }
}
