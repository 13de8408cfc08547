//! Pieces of clusters: those that were cut off, and those that a move would cut off.

use std::cmp::Reverse;
use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::clusters::Clusters;
use super::frontier::Frontier;
use super::labels::Labels;
use crate::surface::DualGraph;
use crate::union_find::root;

/// For walks over faces: a number for each, no matter which at first. Only one thread at a time walks over the faces of a cluster.
pub type Places = [AtomicU32];

/// The faces that a walk came to, in the order in which it did.
///
/// It came to a face if that is the one at the place that `places` has for it, so that nothing is cleared between walks (Briggs &
/// Torczon 1993).
struct Walk<'a> {
    faces: Vec<u32>,
    places: &'a Places,
}

impl Walk<'_> {
    /// Where a face comes in the walk, if it does.
    #[inline]
    fn place(&self, face: u32) -> Option<usize> {
        let place = self.places[face as usize].load(Ordering::Relaxed) as usize;
        (self.faces.get(place) == Some(&face)).then_some(place)
    }

    /// Comes to a face for the first time.
    #[inline]
    fn push(&mut self, face: u32) {
        self.places[face as usize].store(self.faces.len() as u32, Ordering::Relaxed);
        self.faces.push(face);
    }
}

/// The pieces of a cluster, as far as one has to walk to tell them apart.
///
/// A walk sets out from several faces at once, and joins what was reached from them where it meets, until there is at most one
/// set that can still grow. The others then are whole pieces, and all faces that were not reached belong to that one. So it mostly
/// takes as long as there are faces to set out from and faces in the smaller pieces; where boundaries are far apart, as those of a
/// ring, as there are faces between them.
pub struct Pieces<'a> {
    walk: Walk<'a>,
    /// Faces of the walk whose neighbours were looked at.
    looked_at: usize,
    /// The set that each face of the walk was put in; each of the first faces began one.
    set_of_face: Vec<u32>,
    sets: Vec<Set>,
    /// For each set one that it is part of, or itself.
    joined: Vec<u32>,
    /// Sets that are not part of others.
    count: usize,
    /// Those among them that can grow, and the faces of the others.
    open: usize,
    closed_faces: usize,
}

/// What was reached from some faces.
#[derive(Debug, Clone, Copy)]
struct Set {
    faces: u32,
    /// Those whose neighbours were not looked at yet.
    waiting: u32,
}

impl<'a> Pieces<'a> {
    /// Not walked yet.
    pub fn new(places: &'a Places) -> Self {
        Self {
            walk: Walk { faces: Vec::new(), places },
            looked_at: 0,
            set_of_face: Vec::new(),
            sets: Vec::new(),
            joined: Vec::new(),
            count: 0,
            open: 0,
            closed_faces: 0,
        }
    }

    /// Sets out from faces of a cluster, among them one of each piece, and walks until at most one set can grow. Says whether
    /// there are several pieces.
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
        (self.looked_at, self.count, self.open, self.closed_faces) = (0, faces, faces, 0);
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

    /// Goes on until no more than so many sets can grow.
    fn walk_until(&mut self, open: usize, graph: &DualGraph, is_own: impl Fn(u32) -> bool) {
        while self.open > open {
            let face = self.walk.faces[self.looked_at];
            let set = root(&mut self.joined, self.set_of_face[self.looked_at]);
            for &near in graph.neighbours_of(face) {
                if let Some(place) = self.walk.place(near) {
                    let other = root(&mut self.joined, self.set_of_face[place]);
                    if other != set {
                        // which can grow, too: one that cannot has looked at `face`, and would have it
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
            self.looked_at += 1;
            let Set { faces, waiting } = &mut self.sets[set as usize];
            *waiting -= 1;
            if *waiting == 0 {
                self.open -= 1;
                self.closed_faces += *faces as usize;
            }
        }
    }

    /// Appends the faces of all pieces but the one with the most faces, of equally large ones that with the smallest face. The cluster
    /// has `all` faces.
    fn all_but_largest(&mut self, graph: &DualGraph, is_own: impl Fn(u32) -> bool, all: usize, cut_off: &mut Vec<u32>) {
        if 2 * self.closed_faces >= all {
            // the one that can grow may not be the largest
            self.walk_until(0, graph, is_own);
        }
        // the face to be looked at next is of the set that can grow
        let largest = match self.set_of_face.get(self.looked_at) {
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
        let is_whole = |set: &u32| self.joined[*set as usize] == *set;
        (0..self.sets.len() as u32).filter(is_whole).max_by_key(|&set| rank(set)).unwrap_or_default()
    }
}

/// Clusters that one thread looks at before it may get help.
const CLUSTERS_A_PIECE_OF_WORK: usize = 64;

/// The faces outside the piece with the most faces (of equally large ones, that with the smallest face) of each of the
/// given clusters, each given once, sorted.
pub fn cut_off(
    graph: &DualGraph,
    labels: &Labels,
    clusters: &Clusters,
    frontier: &Frontier,
    of_clusters: &[u32],
    places: &Places,
) -> Vec<u32> {
    let mut cut_off: Vec<u32> = of_clusters
        .par_chunks(CLUSTERS_A_PIECE_OF_WORK)
        .flat_map_iter(|of_clusters| {
            let (mut cut_off, mut pieces) = (Vec::new(), Pieces::new(places));
            for &cluster in of_clusters {
                let is_own = |face: u32| labels.of(face) == cluster;
                // a piece that is not all there is has a boundary
                if pieces.are_several(graph, frontier.boundary_of(cluster), is_own) {
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
