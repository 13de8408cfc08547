//! The faces of each cluster, its boundary faces first.

use rayon::prelude::*;

use crate::energy::Functional;
use crate::surface::DualGraph;

/// Faces of a chunk.
const CHUNK: usize = 1 << 13;

/// With more boundary faces than one in so many faces, all faces are gone through in their order, which costs less than
/// to sort some.
const SORTED: usize = 32;

/// Labels, and lists of the faces that have each.
#[derive(Debug, Clone)]
pub struct Lists {
    /// The cluster of each face.
    pub labels: Vec<u32>,
    of_cluster: Vec<List>,
    /// Where each face stands in the list of its cluster.
    place_of_face: Vec<u32>,
    /// How many neighbours each face has in other clusters.
    others_of_face: Vec<u32>,
}

#[derive(Debug, Clone, Default)]
struct List {
    /// The boundary faces, then the others.
    faces: Vec<u32>,
    boundary: usize,
}

impl Lists {
    /// From labels in which every face has one.
    pub fn new<E: Functional>(graph: &DualGraph<E>, labels: Vec<u32>) -> Self {
        let numbers = labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0);
        let mut sizes = vec![0; numbers];
        labels.iter().for_each(|&label| sizes[label as usize] += 1);
        let with_room = |&size: &usize| List { faces: Vec::with_capacity(size), boundary: 0 };
        let mut of_cluster: Vec<List> = sizes.iter().map(with_room).collect();
        let others = |face: u32| {
            let label = labels[face as usize];
            graph.neighbours_of(face).iter().map(|&near| u32::from(labels[near as usize] != label)).sum()
        };
        let faces = 0..labels.len() as u32;
        let others_of_face: Vec<u32> = faces.clone().into_par_iter().with_min_len(CHUNK).map(others).collect();
        let mut place_of_face = vec![0; labels.len()];
        for are_boundary in [true, false] {
            for face in faces.clone().filter(|&face| (others_of_face[face as usize] > 0) == are_boundary) {
                let list = &mut of_cluster[labels[face as usize] as usize];
                place_of_face[face as usize] = list.faces.len() as u32;
                list.boundary += usize::from(are_boundary);
                list.faces.push(face);
            }
        }
        Self { labels, of_cluster, place_of_face, others_of_face }
    }

    /// How many numbers of clusters there are, those without faces among them.
    pub fn len(&self) -> usize {
        self.of_cluster.len()
    }

    /// Adds an empty list. Returns its number.
    pub fn push(&mut self) -> u32 {
        self.of_cluster.push(List::default());
        self.len() as u32 - 1
    }

    /// The faces of a cluster.
    pub fn faces(&self, cluster: u32) -> &[u32] {
        &self.of_cluster[cluster as usize].faces
    }

    /// The boundary faces of a cluster.
    pub fn boundary(&self, cluster: u32) -> &[u32] {
        let List { faces, boundary } = &self.of_cluster[cluster as usize];
        &faces[..*boundary]
    }

    /// The boundary faces of some clusters, and the faces beside them in others, ascending.
    pub fn around<E: Functional>(&self, graph: &DualGraph<E>, changed: &[u32]) -> Vec<u32> {
        let of_changed: usize = changed.iter().map(|&cluster| self.boundary(cluster).len()).sum();
        if of_changed > self.labels.len() / SORTED {
            let mut is_changed = vec![false; self.len()];
            changed.iter().for_each(|&cluster| is_changed[cluster as usize] = true);
            let has_changed = |face: u32| is_changed[self.labels[face as usize] as usize];
            let is_due = |&face: &u32| {
                let is_boundary = self.others_of_face[face as usize] > 0;
                is_boundary && (has_changed(face) || graph.neighbours_of(face).iter().any(|&near| has_changed(near)))
            };
            return (0..self.labels.len() as u32).into_par_iter().with_min_len(CHUNK).filter(is_due).collect();
        }
        let mut faces = Vec::new();
        for &cluster in changed {
            for &face in self.boundary(cluster) {
                faces.push(face);
                let beside = graph.neighbours_of(face).iter();
                faces.extend(beside.filter(|&&near| self.labels[near as usize] != cluster));
            }
        }
        faces.sort_unstable();
        faces.dedup();
        faces
    }

    /// Moves a face to another list.
    pub fn move_face<E: Functional>(&mut self, graph: &DualGraph<E>, face: u32, to: u32) {
        self.set_others(face, 0);
        let from = std::mem::replace(&mut self.labels[face as usize], to);
        let last = self.faces(from).len() - 1;
        self.swap(from, self.place_of_face[face as usize] as usize, last);
        self.of_cluster[from as usize].faces.pop();
        let faces = &mut self.of_cluster[to as usize].faces;
        self.place_of_face[face as usize] = faces.len() as u32;
        faces.push(face);
        let mut others = 0;
        for &near in graph.neighbours_of(face) {
            let (label, of_near) = (self.labels[near as usize], self.others_of_face[near as usize]);
            others += u32::from(label != to);
            if label == from {
                self.set_others(near, of_near + 1);
            } else if label == to {
                self.set_others(near, of_near - 1);
            }
        }
        self.set_others(face, others);
    }

    /// Sets how many neighbours of a face are in other clusters, and puts it among the boundary faces or the others.
    fn set_others(&mut self, face: u32, others: u32) {
        let was_boundary = std::mem::replace(&mut self.others_of_face[face as usize], others) > 0;
        let (cluster, place) = (self.labels[face as usize], self.place_of_face[face as usize] as usize);
        let boundary = &mut self.of_cluster[cluster as usize].boundary;
        if was_boundary && others == 0 {
            *boundary -= 1;
            let last = *boundary;
            self.swap(cluster, place, last);
        } else if !was_boundary && others > 0 {
            let first = *boundary;
            *boundary += 1;
            self.swap(cluster, place, first);
        }
    }

    /// Swaps two faces of a list.
    fn swap(&mut self, cluster: u32, a: usize, b: usize) {
        let faces = &mut self.of_cluster[cluster as usize].faces;
        faces.swap(a, b);
        [a, b].into_iter().for_each(|place| self.place_of_face[faces[place] as usize] = place as u32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::Sample;
    use crate::surface::tests::of_sample;

    #[test]
    fn boundary_faces_come_first_as_faces_move() {
        let surface = of_sample(Sample::Parts, 3000);
        let faces = 0..surface.faces() as u32;
        let mut lists = Lists::new(&surface, faces.clone().map(|face| face / 100).collect());
        let mut sorts = 0;
        for step in [9, 13, 2, 1, 3, 1, 5, 11, 17, 29, 7, 1] {
            let is_beside = |near: &u32, cluster: u32| lists.labels[*near as usize] != cluster;
            for cluster in 0..lists.len() as u32 {
                let is_boundary = |face: &u32| surface.neighbours_of(*face).iter().any(|near| is_beside(near, cluster));
                let of_cluster: Vec<u32> = faces.clone().filter(|face| !is_beside(face, cluster)).collect();
                let sorted = |list: &[u32]| {
                    let mut list = list.to_vec();
                    list.sort_unstable();
                    list
                };
                assert_eq!(sorted(lists.faces(cluster)), of_cluster);
                assert_eq!(
                    sorted(lists.boundary(cluster)),
                    of_cluster.into_iter().filter(is_boundary).collect::<Vec<_>>()
                );
            }
            let changed: Vec<u32> = (0..lists.len() as u32).skip(step % 3).step_by(step).collect();
            let is_due = |&face: &u32| {
                let own = lists.labels[face as usize];
                let mut beside = surface.neighbours_of(face).iter().map(|&near| lists.labels[near as usize]);
                beside.any(|near| near != own && (changed.contains(&own) || changed.contains(&near)))
            };
            let due: Vec<u32> = faces.clone().filter(is_due).collect();
            assert_eq!(lists.around(&surface, &changed), due);
            let listed: usize = changed.iter().map(|&cluster| lists.boundary(cluster).len()).sum();
            sorts += usize::from(listed <= surface.faces() / SORTED);
            for face in due.into_iter().step_by(3) {
                let own = lists.labels[face as usize];
                let beside = surface.neighbours_of(face).iter().map(|&near| lists.labels[near as usize]);
                if let Some(to) = beside.rev().find(|&to| to != own) {
                    lists.move_face(&surface, face, to);
                }
            }
        }
        assert!((1..12).contains(&sorts), "{sorts}");
    }
}
