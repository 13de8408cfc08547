//! The faces of each cluster, its boundary faces first: passes and merges read no others.

use crate::energy::Functional;
use crate::parallel;
use crate::surface::DualGraph;

/// Faces that a thread takes at least.
const CHUNK: usize = 1 << 13;

/// With more boundary faces of changed clusters than one in so many faces, all faces are scanned, which is faster than
/// sorting.
const SCAN_FROM: usize = 32;

/// Labels, and lists of the faces that have each.
#[derive(Debug, Clone)]
pub struct Lists {
    /// The cluster of each face.
    pub labels: Vec<u32>,
    of_cluster: Vec<List>,
    /// Where each face stands in the list of its cluster.
    place_of_face: Vec<u32>,
    /// How many neighbours each face has in other clusters; one that is listed twice counts twice.
    outer_neighbours: Vec<u32>,
}

#[derive(Debug, Clone, Default)]
struct List {
    /// The boundary faces, then the interior ones; in no order within either.
    faces: Vec<u32>,
    /// How many are boundary faces.
    boundary_faces: usize,
}

impl Lists {
    /// From labels in which every face has one.
    pub fn new<E: Functional>(graph: &DualGraph<E>, labels: Vec<u32>) -> Self {
        let numbers = labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0);
        let outer = |face: usize| {
            let label = labels[face];
            graph.neighbours_of(face as u32).iter().map(|&near| u32::from(labels[near as usize] != label)).sum()
        };
        let outer_neighbours: Vec<u32> = parallel::map(labels.len(), CHUNK, outer);
        // how many boundary and how many interior faces each cluster has, then where the next one of either goes
        let mut next = vec![[0u32; 2]; numbers];
        let is_interior = |face: usize| usize::from(outer_neighbours[face] == 0);
        (0..).zip(&labels).for_each(|(face, &label)| next[label as usize][is_interior(face)] += 1);
        let with_room = |next: &mut [u32; 2]| {
            let [boundary, interior] = std::mem::replace(next, [0, next[0]]);
            List { faces: vec![0; (boundary + interior) as usize], boundary_faces: boundary as usize }
        };
        let mut of_cluster: Vec<List> = next.iter_mut().map(with_room).collect();
        let mut place_of_face = vec![0; labels.len()];
        for (face, &label) in labels.iter().enumerate() {
            let next = &mut next[label as usize][is_interior(face)];
            place_of_face[face] = *next;
            of_cluster[label as usize].faces[*next as usize] = face as u32;
            *next += 1;
        }
        Self { labels, of_cluster, place_of_face, outer_neighbours }
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
        let List { faces, boundary_faces } = &self.of_cluster[cluster as usize];
        &faces[..*boundary_faces]
    }

    /// The boundary faces of some clusters, and the faces beside them in others, ascending.
    pub fn around<E: Functional>(&self, graph: &DualGraph<E>, changed: &[u32]) -> Vec<u32> {
        let of_changed: usize = changed.iter().map(|&cluster| self.boundary(cluster).len()).sum();
        if of_changed > self.labels.len() / SCAN_FROM {
            let mut is_changed = vec![false; self.len()];
            changed.iter().for_each(|&cluster| is_changed[cluster as usize] = true);
            let has_changed = |face: u32| is_changed[self.labels[face as usize] as usize];
            let is_due = |&face: &u32| {
                let is_boundary = self.outer_neighbours[face as usize] > 0;
                is_boundary && (has_changed(face) || graph.neighbours_of(face).iter().any(|&near| has_changed(near)))
            };
            return parallel::filter(self.labels.len(), CHUNK, is_due);
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

    /// Moves a face to the list of another cluster.
    pub fn move_face<E: Functional>(&mut self, graph: &DualGraph<E>, face: u32, to: u32) {
        self.set_outer_neighbours(face, 0);
        let from = std::mem::replace(&mut self.labels[face as usize], to);
        let last = self.faces(from).len() - 1;
        self.swap(from, self.place_of_face[face as usize] as usize, last);
        self.of_cluster[from as usize].faces.pop();
        let faces = &mut self.of_cluster[to as usize].faces;
        self.place_of_face[face as usize] = faces.len() as u32;
        faces.push(face);
        let mut outer = 0;
        for &near in graph.neighbours_of(face) {
            let (label, of_near) = (self.labels[near as usize], self.outer_neighbours[near as usize]);
            outer += u32::from(label != to);
            if label == from {
                self.set_outer_neighbours(near, of_near + 1);
            } else if label == to {
                self.set_outer_neighbours(near, of_near - 1);
            }
        }
        self.set_outer_neighbours(face, outer);
    }

    /// Sets how many neighbours of a face are in other clusters, and makes it a boundary face or an interior one.
    fn set_outer_neighbours(&mut self, face: u32, outer: u32) {
        let was_boundary = std::mem::replace(&mut self.outer_neighbours[face as usize], outer) > 0;
        let (cluster, place) = (self.labels[face as usize], self.place_of_face[face as usize] as usize);
        let boundary_faces = &mut self.of_cluster[cluster as usize].boundary_faces;
        if was_boundary && outer == 0 {
            *boundary_faces -= 1;
            let last = *boundary_faces;
            self.swap(cluster, place, last);
        } else if !was_boundary && outer > 0 {
            let first = *boundary_faces;
            *boundary_faces += 1;
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
    use crate::dev::random;
    use crate::dev::sample::Sample;
    use crate::surface::tests::of_sample;
    use crate::surface::{Component, Moves, Rows};

    /// A graph with such neighbours.
    fn graph_of(neighbours: Vec<Vec<u32>>) -> DualGraph {
        let faces = neighbours.len();
        let mut rows = Rows::empty(0);
        neighbours.into_iter().for_each(|row| rows.push(row));
        DualGraph {
            points: vec![[0; 3]; faces],
            weights: vec![1; faces],
            neighbours: rows,
            components: vec![Component { first_face: 0, faces: faces as u32, weight: faces as u64, energy_shift: 0 }],
            moves: Moves::Free,
        }
    }

    /// In how many rounds of moves, some of them to new lists, all lists and `around` are as defined; and in how many
    /// `around` sorts.
    fn rounds_that_agree(graph: &DualGraph, move_face: impl Fn(&mut Lists, u32, u32)) -> (usize, usize) {
        let faces = 0..graph.faces() as u32;
        let mut lists = Lists::new(graph, faces.clone().map(|face| face / 50).collect());
        let mut states = random(1);
        let mut below = |bound: usize| (states() >> 33) as usize % bound;
        let (mut agree, mut sorted) = (0, 0);
        for _ in 0..ROUNDS {
            let label = |face: u32| lists.labels[face as usize];
            let outer = |face: u32| graph.neighbours_of(face).iter().any(|&near| label(near) != label(face));
            let is_right = |cluster: u32| {
                let faces = faces.clone().filter(|&face| label(face) == cluster);
                let of_cluster = ascending(lists.faces(cluster)).eq(faces.clone());
                of_cluster && ascending(lists.boundary(cluster)).eq(faces.filter(|&face| outer(face)))
            };
            let changed: Vec<u32> = (0..lists.len() as u32).step_by(1 + below(60)).collect();
            let is_due = |&face: &u32| {
                let mut beside = graph.neighbours_of(face).iter().map(|&near| label(near));
                beside.any(|near| near != label(face) && (changed.contains(&label(face)) || changed.contains(&near)))
            };
            let due: Vec<u32> = faces.clone().filter(is_due).collect();
            agree += usize::from((0..lists.len() as u32).all(is_right) && lists.around(graph, &changed) == due);
            let listed: usize = changed.iter().map(|&cluster| lists.boundary(cluster).len()).sum();
            sorted += usize::from(listed <= graph.faces() / SCAN_FROM);
            let new = lists.push();
            for _ in 0..100 {
                let face = below(graph.faces()) as u32;
                let to = if below(9) == 0 { new } else { below(lists.len()) as u32 };
                if lists.labels[face as usize] != to {
                    move_face(&mut lists, face, to);
                }
            }
        }
        (agree, sorted)
    }

    const ROUNDS: usize = 12;

    fn ascending(faces: &[u32]) -> impl Iterator<Item = u32> {
        let mut faces = faces.to_vec();
        faces.sort_unstable();
        faces.into_iter()
    }

    #[test]
    fn boundary_faces_come_first_as_faces_move() {
        let parts = of_sample(Sample::Parts, 3000).items.graph;
        // each face twice beside the next
        let twice = |face: u32| [face ^ 1, face ^ 1, (face + 999) % 1000, (face + 1) % 1000];
        let mut hub = vec![(1..500).collect()];
        hub.extend((1..500).map(|_| vec![0]));
        let mut sorts = 0;
        for graph in [parts, graph_of((0..1000).map(|face| twice(face).to_vec()).collect()), graph_of(hub)] {
            let (agree, sorted) = rounds_that_agree(&graph, |lists, face, to| lists.move_face(&graph, face, to));
            assert_eq!(agree, ROUNDS);
            sorts += sorted;
            let without_lists = |lists: &mut Lists, face: u32, to: u32| lists.labels[face as usize] = to;
            assert!(rounds_that_agree(&graph, without_lists).0 < ROUNDS, "lists that labels leave behind are noticed");
        }
        assert!((1..3 * ROUNDS).contains(&sorts), "{sorts}");
    }
}
