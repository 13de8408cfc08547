//! Boundary-based optimisation (P§3.2): the synchronous iteration that [`crate::cluster`] defines.

use rayon::prelude::*;

use super::clusters::Clusters;
use super::labels::Labels;
use super::{CHUNK, Move};
use crate::surface::DualGraph;

/// The moves that the faces want and the last-face rule allows.
pub fn moves(graph: &DualGraph, labels: &Labels, clusters: &Clusters, due: &[u32], leaving: &mut Leaving) -> Vec<Move> {
    let mut wanted: Vec<Move> = due
        .par_chunks(CHUNK)
        .flat_map_iter(|faces| faces.iter().filter_map(|&face| decide(graph, labels, clusters, face)))
        .collect();
    let kept_back = leaving.kept_back(&wanted, clusters);
    if !kept_back.is_empty() {
        wanted.retain(|leaver| kept_back.binary_search(&leaver.face).is_err());
    }
    wanted
}

/// Where a face wants to go: to the neighbouring cluster whose proxy is nearest, if that is nearer than its own's; the
/// smaller number where two are equally near.
fn decide(graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32) -> Option<Move> {
    let from = labels.near_boundary(face);
    let centroid = graph.centroids[face as usize];
    let mut best = None;
    let mut last = from;
    for &near in graph.neighbours_of(face) {
        let cluster = labels.near_boundary(near);
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

/// How many faces want to leave each cluster, and the smallest of them: for the last-face rule. Zero between uses.
#[derive(Debug)]
pub struct Leaving(Vec<(u32, u32)>);

impl Leaving {
    /// Nobody wants to leave any of `clusters` clusters.
    pub fn new(clusters: usize) -> Self {
        Self(vec![(0, 0); clusters])
    }

    /// The faces that the last-face rule keeps back, sorted.
    fn kept_back(&mut self, wanted: &[Move], clusters: &Clusters) -> Vec<u32> {
        for leaver in wanted {
            let (count, smallest) = &mut self.0[leaver.from as usize];
            *smallest = if *count == 0 { leaver.face } else { leaver.face.min(*smallest) };
            *count += 1;
        }
        let mut kept = Vec::new();
        for leaver in wanted {
            let (count, smallest) = std::mem::take(&mut self.0[leaver.from as usize]);
            if count == clusters.sums(leaver.from).faces {
                kept.push(smallest);
            }
        }
        kept.sort_unstable();
        kept
    }
}
