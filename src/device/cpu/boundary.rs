//! Boundary-based optimisation (P§3.2): the synchronous iteration that [`crate::cluster`] defines.

use rayon::prelude::*;

use super::clusters::Clusters;
use super::frontier::Frontier;
use super::{CHUNK, Move};
use crate::surface::Surface;

/// How many faces want to leave each cluster, and the smallest of them: for the last-face rule.
#[derive(Debug)]
pub struct Leaving(Vec<(u32, u32)>);

impl Leaving {
    /// Nobody wants to leave any of `clusters` clusters.
    pub fn new(clusters: usize) -> Self {
        Self(vec![(0, 0); clusters])
    }

    /// The faces that the last-face rule keeps back, sorted. Leaves the counts at zero.
    fn kept_back(&mut self, wanted: &[Vec<Move>], clusters: &Clusters) -> Vec<u32> {
        for leaver in wanted.iter().flatten() {
            let (count, smallest) = &mut self.0[leaver.from as usize];
            *smallest = if *count == 0 { leaver.face } else { leaver.face.min(*smallest) };
            *count += 1;
        }
        let mut kept = Vec::new();
        for leaver in wanted.iter().flatten() {
            let (count, smallest) = std::mem::take(&mut self.0[leaver.from as usize]);
            if count == clusters.faces(leaver.from) {
                kept.push(smallest);
            }
        }
        kept.sort_unstable();
        kept
    }
}

/// One iteration over the faces that are due. Returns how many moved.
pub fn iterate(
    surface: &Surface,
    labels: &mut [u32],
    clusters: &mut Clusters,
    frontier: &mut Frontier,
    leaving: &mut Leaving,
) -> u64 {
    let due = frontier.due(surface, labels, clusters.changed());
    let wanted: Vec<Vec<Move>> = {
        let (labels, clusters) = (&*labels, &*clusters);
        due.par_chunks(CHUNK)
            .map(|faces| faces.iter().filter_map(|&face| decide(surface, labels, clusters, face)).collect())
            .collect()
    };
    let kept_back = leaving.kept_back(&wanted, clusters);
    clusters.begin_iteration();
    let mut moves = 0;
    for &Move { face, from, to } in wanted.iter().flatten() {
        if !kept_back.is_empty() && kept_back.binary_search(&face).is_ok() {
            continue;
        }
        labels[face as usize] = to;
        clusters.transfer(surface, face, from, to);
        frontier.moved(surface, labels, face);
        moves += 1;
    }
    clusters.refit();
    moves
}

/// Where a face wants to go: to the neighbouring cluster whose proxy is nearest, if that is nearer than its own's; the
/// smaller number where two are equally near.
fn decide(surface: &Surface, labels: &[u32], clusters: &Clusters, face: u32) -> Option<Move> {
    let from = labels[face as usize];
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
