//! Boundary-based optimisation (P§3.2): the synchronous iteration that [`crate::cluster`] defines.

use rayon::prelude::*;

use super::clusters::Clusters;
use crate::surface::Surface;

/// Faces a thread takes at a time.
const CHUNK: usize = 2048;
/// The list of candidates is thinned every so many iterations.
const THIN_EVERY: u32 = 8;

/// A face that wants to leave its cluster.
#[derive(Debug, Clone, Copy)]
struct Move {
    face: u32,
    from: u32,
    to: u32,
}

/// The faces that may have a neighbour in another cluster.
#[derive(Debug, Default)]
pub struct Boundary {
    /// Every face with a neighbour in another cluster, and maybe some more.
    candidates: Vec<u32>,
    is_candidate: Vec<bool>,
    /// Whether all candidates must be looked at, changed clusters or not.
    look_at_all: bool,
    iterations: u32,
    /// Per cluster, for the last-face rule: how many faces want to leave, and the smallest of them. Zero between uses.
    leaving: Vec<(u32, u32)>,
}

impl Boundary {
    /// Finds the boundary of new labels.
    pub fn collect(&mut self, surface: &Surface, labels: &[u32]) {
        self.is_candidate = (0..labels.len() as u32)
            .into_par_iter()
            .map(|face| is_boundary(surface, labels, face))
            .collect();
        self.candidates = (0..labels.len() as u32)
            .filter(|&face| self.is_candidate[face as usize])
            .collect();
        self.look_at_all = true;
        self.iterations = 0;
    }

    /// One iteration: all faces decide on the labels and proxies at its start. Returns how many moved.
    pub fn iterate(
        &mut self,
        surface: &Surface,
        labels: &mut [u32],
        clusters: &mut Clusters,
    ) -> u64 {
        let look_at_all = std::mem::replace(&mut self.look_at_all, false);
        let wanted: Vec<Vec<Move>> = {
            let (labels, clusters) = (&*labels, &*clusters);
            self.candidates
                .par_chunks(CHUNK)
                .map(|faces| {
                    faces
                        .iter()
                        .filter_map(|&face| decide(surface, labels, clusters, face, look_at_all))
                        .collect()
                })
                .collect()
        };
        self.leaving
            .resize(self.leaving.len().max(clusters.len()), (0, 0));
        for leaver in wanted.iter().flatten() {
            let (count, smallest) = &mut self.leaving[leaver.from as usize];
            *smallest = if *count == 0 {
                leaver.face
            } else {
                leaver.face.min(*smallest)
            };
            *count += 1;
        }
        let mut emptied = Vec::new();
        for leaver in wanted.iter().flatten() {
            let (count, smallest) = std::mem::take(&mut self.leaving[leaver.from as usize]);
            if count == clusters.faces(leaver.from) {
                emptied.push(smallest);
            }
        }
        emptied.sort_unstable();

        clusters.begin_iteration();
        let mut moves = 0;
        for &Move { face, from, to } in wanted.iter().flatten() {
            if !emptied.is_empty() && emptied.binary_search(&face).is_ok() {
                continue;
            }
            labels[face as usize] = to;
            clusters.transfer(surface, face, from, to);
            moves += 1;
            for &near in surface.neighbours_of(face) {
                if !std::mem::replace(&mut self.is_candidate[near as usize], true) {
                    self.candidates.push(near);
                }
            }
        }
        clusters.refit();
        self.iterations += 1;
        if self.iterations.is_multiple_of(THIN_EVERY) {
            self.thin(surface, labels);
        }
        moves
    }

    /// Drops candidates that no longer lie on a boundary, and sorts the rest for locality.
    fn thin(&mut self, surface: &Surface, labels: &[u32]) {
        self.candidates.retain(|&face| {
            let keep = is_boundary(surface, labels, face);
            self.is_candidate[face as usize] = keep;
            keep
        });
        self.candidates.sort_unstable();
    }
}

/// Whether a face has a neighbour in another cluster.
fn is_boundary(surface: &Surface, labels: &[u32], face: u32) -> bool {
    let own = labels[face as usize];
    surface
        .neighbours_of(face)
        .iter()
        .any(|&neighbour| labels[neighbour as usize] != own)
}

/// Where a face wants to go: to the neighbouring cluster whose proxy is nearest, if that is nearer than its own's; the
/// smaller number where two are equally near. None when nothing has changed since it was last looked at.
fn decide(
    surface: &Surface,
    labels: &[u32],
    clusters: &Clusters,
    face: u32,
    look_at_all: bool,
) -> Option<Move> {
    let from = labels[face as usize];
    let is_due = look_at_all
        || clusters.has_changed(from)
        || surface
            .neighbours_of(face)
            .iter()
            .any(|&near| clusters.has_changed(labels[near as usize]));
    if !is_due {
        return None;
    }
    let centroid = surface.centroids[face as usize];
    let mut best = None;
    let mut last = from;
    for &neighbour in surface.neighbours_of(face) {
        let cluster = labels[neighbour as usize];
        if cluster != from && cluster != last {
            let offer = (clusters.squared_distance(centroid, cluster), cluster);
            if best.is_none_or(|best| offer < best) {
                best = Some(offer);
            }
            last = cluster;
        }
    }
    let (distance, to) = best?;
    (distance < clusters.squared_distance(centroid, from)).then_some(Move { face, from, to })
}
