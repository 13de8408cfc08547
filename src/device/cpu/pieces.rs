//! Pieces of clusters: those that were cut off, and those that a move would cut off.

use std::cmp::Reverse;
use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::View;
use super::boundary_faces::BoundaryFaces;
use super::labels::Labels;
use super::tuning::chunks::CLUSTERS;
use crate::surface::DualGraph;
use crate::union_find::root;

/// Scratch memory of walks: a number for each face, of any value. One thread at a time walks over the faces of a
/// cluster.
pub type Places = [AtomicU32];

/// The faces that a walk has visited, in order.
///
/// A face was visited if it is the one at the place that `places` has for it. So nothing is cleared between walks (the
/// sparse set of Briggs & Torczon 1993).
struct Walk<'a> {
    faces: Vec<u32>,
    places: &'a Places,
}

impl Walk<'_> {
    /// The place of a face in the walk, if it was visited.
    #[inline]
    fn place(&self, face: u32) -> Option<usize> {
        let place = self.places[face as usize].load(Ordering::Relaxed) as usize;
        (self.faces.get(place) == Some(&face)).then_some(place)
    }

    /// Visits a face for the first time.
    #[inline]
    fn push(&mut self, face: u32) {
        self.places[face as usize].store(self.faces.len() as u32, Ordering::Relaxed);
        self.faces.push(face);
    }
}

/// The pieces of a cluster, searched no further than needed to tell them apart.
///
/// A breadth-first walk starts from all boundary faces at once; each begins a set, and sets that meet are joined. It
/// ends when at most one set can still grow: the others are whole pieces, and all faces that were not visited belong to
/// that one. The cost is that of the boundary faces and of the smaller pieces, mostly; in a ring, that of the faces
/// between its two boundaries.
pub struct Pieces<'a> {
    walk: Walk<'a>,
    /// Faces of the walk whose neighbours were visited.
    expanded: usize,
    /// The set that each face of the walk was put in.
    set_of_face: Vec<u32>,
    sets: Vec<Set>,
    /// A union-find forest of the sets.
    joined: Vec<u32>,
    /// Number of sets that were not joined to others.
    count: usize,
    /// Number of those that can grow, and of faces in those that cannot.
    open: usize,
    closed_faces: usize,
}

/// A set of visited faces.
#[derive(Debug, Clone, Copy)]
struct Set {
    faces: u32,
    /// Those that were not expanded yet.
    waiting: u32,
}

impl<'a> Pieces<'a> {
    /// Before any walk.
    pub fn new(places: &'a Places) -> Self {
        Self {
            walk: Walk { faces: Vec::new(), places },
            expanded: 0,
            set_of_face: Vec::new(),
            sets: Vec::new(),
            joined: Vec::new(),
            count: 0,
            open: 0,
            closed_faces: 0,
        }
    }

    /// Walks from faces of a cluster, at least one of each piece, until at most one set can grow. Returns whether there
    /// are several pieces.
    fn are_several(
        &mut self,
        graph: &DualGraph,
        from: impl Iterator<Item = u32>,
        is_own: impl Fn(u32) -> bool,
    ) -> bool {
        self.walk.faces.clear();
        for face in from {
            if self.walk.place(face).is_none() {
                self.walk.push(face);
            }
        }
        let faces = self.walk.faces.len();
        self.joined.clear();
        self.joined.extend(0..faces as u32);
        self.set_of_face.clone_from(&self.joined);
        self.sets.clear();
        self.sets.resize(faces, Set { faces: 1, waiting: 1 });
        (self.expanded, self.count, self.open, self.closed_faces) = (0, faces, faces, 0);
        self.walk_until(1, graph, is_own);
        self.count > 1
    }

    /// Whether a connected cluster stays connected when it loses one of its faces.
    pub fn stays_connected(&mut self, graph: &DualGraph, labels: &Labels, face: u32) -> bool {
        let cluster = labels.of(face);
        let is_own = |near: u32| near != face && labels.of(near) == cluster;
        let beside = graph.neighbours_of(face).iter().copied().filter(|&near| is_own(near));
        !self.are_several(graph, beside, is_own)
    }

    /// Continues the walk until at most `open` sets can grow.
    fn walk_until(&mut self, open: usize, graph: &DualGraph, is_own: impl Fn(u32) -> bool) {
        while self.open > open {
            let face = self.walk.faces[self.expanded];
            let set = root(&mut self.joined, self.set_of_face[self.expanded]);
            for &near in graph.neighbours_of(face) {
                if let Some(place) = self.walk.place(near) {
                    let other = root(&mut self.joined, self.set_of_face[place]);
                    if other != set {
                        // both can grow: a set that cannot has expanded the neighbours of all its faces, `face` among
                        // them
                        self.joined[other as usize] = set;
                        let Set { faces, waiting } = self.sets[other as usize];
                        self.sets[set as usize].faces += faces;
                        self.sets[set as usize].waiting += waiting;
                        self.count -= 1;
                        self.open -= 1;
                    }
                } else if is_own(near) {
                    self.walk.push(near);
                    self.set_of_face.push(set);
                    self.sets[set as usize].faces += 1;
                    self.sets[set as usize].waiting += 1;
                }
            }
            self.expanded += 1;
            let Set { faces, waiting } = &mut self.sets[set as usize];
            *waiting -= 1;
            if *waiting == 0 {
                self.open -= 1;
                self.closed_faces += *faces as usize;
            }
        }
    }

    /// Appends the faces outside the largest piece to `cut_off`, after [`are_several`](Self::are_several). The cluster
    /// has `all` faces.
    fn all_but_largest(&mut self, graph: &DualGraph, is_own: impl Fn(u32) -> bool, all: usize, cut_off: &mut Vec<u32>) {
        if 2 * self.closed_faces >= all {
            // the set that can grow may not be the largest
            self.walk_until(0, graph, is_own);
        }
        // the next face to be expanded is of the set that can grow
        let largest = match self.set_of_face.get(self.expanded) {
            Some(&set) => root(&mut self.joined, set),
            None => self.largest_of_all(),
        };
        for (&face, &set) in self.walk.faces.iter().zip(&self.set_of_face) {
            if root(&mut self.joined, set) != largest {
                cut_off.push(face);
            }
        }
    }

    /// The set with the most faces, of equally large ones that with the smallest face, when none can grow.
    fn largest_of_all(&mut self) -> u32 {
        let mut smallest = vec![u32::MAX; self.sets.len()];
        for (&face, &set) in self.walk.faces.iter().zip(&self.set_of_face) {
            let of_set = &mut smallest[root(&mut self.joined, set) as usize];
            *of_set = face.min(*of_set);
        }
        let rank = |set: u32| (self.sets[set as usize].faces, Reverse(smallest[set as usize]));
        let is_root = |set: &u32| self.joined[*set as usize] == *set;
        (0..self.sets.len() as u32).filter(is_root).max_by_key(|&set| rank(set)).unwrap_or_default()
    }
}

/// The faces outside the piece with the most faces (of equally large ones, that with the smallest face) of each of the
/// given clusters, each given once, sorted.
pub fn cut_off(view: View<'_>, boundary: &BoundaryFaces, of_clusters: &[u32], places: &Places) -> Vec<u32> {
    let View { graph, labels, clusters } = view;
    let mut cut_off: Vec<u32> = of_clusters
        .par_chunks(CLUSTERS)
        .flat_map_iter(|of_clusters| {
            let (mut cut_off, mut pieces) = (Vec::new(), Pieces::new(places));
            for &cluster in of_clusters {
                let is_own = |face: u32| labels.of(face) == cluster;
                // of several pieces, each has a boundary face
                if pieces.are_several(graph, boundary.of_cluster(cluster), is_own) {
                    let all = clusters.sums(cluster).faces as usize;
                    pieces.all_but_largest(graph, is_own, all, &mut cut_off);
                }
            }
            cut_off
        })
        .collect();
    cut_off.sort_unstable();
    cut_off
}
