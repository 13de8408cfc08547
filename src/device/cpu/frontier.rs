//! The boundary faces of each cluster, and which faces need another look.
//!
//! A face decides by its own and its neighbours' clusters, so it needs another look only when one of those gained or
//! lost a face; all others would decide as they did before. Faces that can decide anything lie on a boundary, so the
//! faces to look at are found from the boundary lists of the clusters that changed, at a cost in proportion to those.

use crate::device::FREE;
use crate::surface::Surface;

/// One list of boundary faces a cluster.
///
/// A list holds every boundary face of its cluster, and maybe faces that no longer are; those go when it is next read.
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
    pub fn collect(surface: &Surface, labels: &[u32], clusters: usize) -> Self {
        let mut frontier = Self {
            faces_of_cluster: vec![Vec::new(); clusters],
            listed_in: vec![FREE; labels.len()],
            due_in: vec![0; labels.len()],
            reading: 0,
            due: Vec::new(),
        };
        for face in 0..labels.len() as u32 {
            if is_boundary(surface, labels, face) {
                frontier.list(face, labels[face as usize]);
            }
        }
        frontier
    }

    /// The faces listed for the changed clusters and the faces beside them, each once. A face of a changed cluster or
    /// with a neighbour in one that is not among them lies on no boundary and did not before.
    pub fn due(&mut self, surface: &Surface, labels: &[u32], changed: &[u32]) -> &[u32] {
        self.reading += 1;
        self.due.clear();
        for &cluster in changed {
            let mut faces = std::mem::take(&mut self.faces_of_cluster[cluster as usize]);
            faces.retain(|&face| {
                if labels[face as usize] != cluster {
                    return false;
                }
                let mut is_boundary = false;
                for &near in surface.neighbours_of(face) {
                    if labels[near as usize] != cluster {
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

    /// Whether a face was due in the last reading.
    pub fn was_due(&self, face: u32) -> bool {
        self.due_in[face as usize] == self.reading
    }

    /// Keeps the lists in step with a face that has moved; `labels` already say so.
    pub fn moved(&mut self, surface: &Surface, labels: &[u32], face: u32) {
        let to = labels[face as usize];
        self.list(face, to);
        for &near in surface.neighbours_of(face) {
            let cluster = labels[near as usize];
            if cluster != to && self.listed_in[near as usize] != cluster {
                self.list(near, cluster);
            }
        }
    }

    fn list(&mut self, face: u32, cluster: u32) {
        self.listed_in[face as usize] = cluster;
        self.faces_of_cluster[cluster as usize].push(face);
    }

    fn mark(&mut self, face: u32) {
        if std::mem::replace(&mut self.due_in[face as usize], self.reading) != self.reading {
            self.due.push(face);
        }
    }
}

/// Whether a face has a neighbour in another cluster.
fn is_boundary(surface: &Surface, labels: &[u32], face: u32) -> bool {
    let own = labels[face as usize];
    surface.neighbours_of(face).iter().any(|&neighbour| labels[neighbour as usize] != own)
}
