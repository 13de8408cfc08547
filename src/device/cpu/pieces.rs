//! Pieces of clusters: those that were cut off, among the clusters that may be in several; which may be, when a face has left;
//! and those that a move would cut off.

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::clusters::Clusters;
use super::frontier::Frontier;
use super::labels::Labels;
use crate::surface::DualGraph;

/// For walks over faces: the last walk that came to each.
pub type Walked = [AtomicU32];

/// Whether a walk comes to a face for the first time, and may go there. Only one thread walks over the faces of a cluster, so
/// nobody else comes to the same ones.
fn comes_to(walked: &Walked, walk: u32, face: u32, may_go: impl FnOnce() -> bool) -> bool {
    let last = &walked[face as usize];
    let comes = last.load(Ordering::Relaxed) != walk && may_go();
    if comes {
        last.store(walk, Ordering::Relaxed);
    }
    comes
}

/// Clusters that one thread looks at before it may get help.
const CLUSTERS_A_PIECE_OF_WORK: usize = 64;

/// The faces outside the piece with the most faces (of equally large ones, that with the smallest face) of each of the
/// given clusters, each given once, sorted.
///
/// A cluster in several pieces has boundary faces in each, so walks from its boundary faces find them all. `walked` has
/// one number a face, none of them `walk` on entry.
pub fn cut_off(
    graph: &DualGraph,
    labels: &Labels,
    clusters: &Clusters,
    frontier: &Frontier,
    of_clusters: &[u32],
    walked: &Walked,
    walk: u32,
) -> Vec<u32> {
    let mut cut_off: Vec<u32> = of_clusters
        .par_chunks(CLUSTERS_A_PIECE_OF_WORK)
        .flat_map_iter(|of_clusters| {
            let (mut cut_off, mut pieces) = (Vec::new(), Pieces::default());
            for &cluster in of_clusters {
                let all = clusters.sums(cluster).faces as usize;
                pieces.find(graph, labels, cluster, frontier.boundary_of(cluster), all, walked, walk);
                pieces.all_but_largest(&mut cut_off);
            }
            cut_off
        })
        .collect();
    cut_off.sort_unstable();
    cut_off
}

/// The pieces of a cluster.
#[derive(Default)]
struct Pieces {
    /// The faces, piece by piece.
    faces: Vec<u32>,
    /// Where each piece ends.
    ends: Vec<usize>,
}

impl Pieces {
    /// Finds the pieces of a cluster of so many faces in all.
    #[expect(clippy::too_many_arguments, reason = "a walk needs to know all of it")]
    fn find(
        &mut self,
        graph: &DualGraph,
        labels: &Labels,
        cluster: u32,
        boundary: impl Iterator<Item = u32>,
        all: usize,
        walked: &Walked,
        walk: u32,
    ) {
        self.faces.clear();
        self.ends.clear();
        for start in boundary {
            if self.faces.len() == all {
                return;
            }
            if !comes_to(walked, walk, start, || true) {
                continue;
            }
            let mut next = self.faces.len();
            self.faces.push(start);
            while let Some(&face) = self.faces.get(next) {
                next += 1;
                for &near in graph.neighbours_of(face) {
                    if comes_to(walked, walk, near, || labels.of(near) == cluster) {
                        self.faces.push(near);
                    }
                }
            }
            self.ends.push(next);
        }
    }

    /// Appends the faces of all pieces but the one with the most faces, of equally large ones that with the smallest face.
    fn all_but_largest(&self, cut_off: &mut Vec<u32>) {
        if self.ends.len() < 2 {
            return;
        }
        let starts = std::iter::once(&0).chain(&self.ends);
        let pieces: Vec<&[u32]> = starts.zip(&self.ends).map(|(&start, &end)| &self.faces[start..end]).collect();
        let smallest_face = |piece: &[u32]| piece.iter().copied().min();
        let largest =
            (0..pieces.len()).max_by_key(|&at| (pieces[at].len(), std::cmp::Reverse(smallest_face(pieces[at]))));
        for (at, piece) in pieces.iter().enumerate() {
            if Some(at) != largest {
                cut_off.extend_from_slice(piece);
            }
        }
    }
}

/// Faces that lie close to another, at most so many of them.
const NEARBY: usize = 16;

/// Faces that are looked at for a way around one that left.
const LOOKS: usize = 32;

/// Neighbours of each of them that are: large polygons have more.
const BESIDE: usize = 16;

/// Steps of a way around a face from one side; from the other it is two.
const STEPS: usize = 3;

/// Whether a cluster that was connected surely still is, now that a face has left it: whether there is a short way around
/// the face between those of the cluster that lie beside it, which each way over the face can go instead.
///
/// Some 3 % of the faces that leave a cluster have none (bunny, whole hierarchy with optimisation, defaults).
pub fn surely_stays_whole(graph: &DualGraph, labels: &Labels, face: u32, cluster: u32) -> bool {
    let is_own = |near: &u32| labels.of(*near) == cluster;
    let mut own = graph.neighbours_of(face).iter().copied().filter(is_own);
    let Some((first, second)) = own.next().zip(own.next()) else { return true };
    let mut nearby = [first; NEARBY];
    let mut found = 1;
    for step in [0, 1] {
        let from = if step == 0 { 0..1 } else { 1..found };
        for at in from {
            for near in graph.neighbours_of(nearby[at]).iter().take(BESIDE).copied().filter(is_own) {
                if found < NEARBY && near != first {
                    nearby[found] = near;
                    found += 1;
                }
            }
        }
    }
    let mut looks = LOOKS;
    std::iter::once(second)
        .chain(own)
        .all(|other| leads_to(graph, &is_own, &nearby[..found], [other, face], STEPS, &mut looks))
}

/// Whether a walk over so many faces of a cluster comes to one of `nearby`; `face` was reached from the one after it.
fn leads_to(
    graph: &DualGraph,
    is_own: &impl Fn(&u32) -> bool,
    nearby: &[u32],
    [face, before]: [u32; 2],
    steps: usize,
    looks: &mut usize,
) -> bool {
    if nearby.contains(&face) {
        return true;
    }
    if steps == 0 {
        return false;
    }
    graph.neighbours_of(face).iter().take(BESIDE).any(|&near| {
        if near == before || *looks == 0 || !is_own(&near) {
            return false;
        }
        *looks -= 1;
        leads_to(graph, is_own, nearby, [near, face], steps - 1, looks)
    })
}

/// Whether a face lies beside one of a cluster.
pub fn is_beside(graph: &DualGraph, labels: &Labels, face: u32, cluster: u32) -> bool {
    graph.neighbours_of(face).iter().any(|&near| labels.of(near) == cluster)
}

/// Whether a cluster stays connected when it loses one of its faces, given that it is connected. `walked` and `walk` are as
/// for [`cut_off`].
pub fn stays_connected(graph: &DualGraph, labels: &Labels, face: u32, walked: &Walked, walk: u32) -> bool {
    let cluster = labels.of(face);
    let is_own = |near: &&u32| labels.of(**near) == cluster;
    let mut own: Vec<u32> = graph.neighbours_of(face).iter().filter(is_own).copied().collect();
    own.sort_unstable();
    own.dedup();
    let Some(start) = own.pop() else { return true };
    comes_to(walked, walk, face, || true);
    comes_to(walked, walk, start, || true);
    let mut queue = std::collections::VecDeque::from([start]);
    while !own.is_empty() {
        let Some(reached) = queue.pop_front() else { return false };
        for &near in graph.neighbours_of(reached) {
            if comes_to(walked, walk, near, || labels.of(near) == cluster) {
                own.retain(|&wanted| wanted != near);
                queue.push_back(near);
            }
        }
    }
    true
}
