//! Boundary-based optimisation (P§3.2): the synchronous iteration that [`crate::cluster`] defines.

use rayon::prelude::*;

use super::clusters::Clusters;
use super::labels::Labels;
use super::watch::{Slack, Watch, boundary_slack};
use super::{CHUNK, Move, batch};
use crate::surface::DualGraph;

/// What a face does.
#[derive(Debug, Clone, Copy)]
enum Decision {
    /// It wants to move to a cluster.
    Move(u32),
    /// It stays, and need not be asked again before clusters have drifted that far.
    Stay(Slack),
}

/// The moves that the faces that are due want and the last-face rule allows; the others rest.
pub fn moves(
    graph: &DualGraph,
    labels: &Labels,
    clusters: &Clusters,
    watch: &mut Watch,
    leaving: &mut Leaving,
) -> Vec<Move> {
    let due = watch.take_due();
    let mut wanted = Vec::new();
    let mut act = |watch: &mut Watch, face: u32, decision: Decision| match decision {
        Decision::Move(to) => wanted.push(Move { face, from: labels.near_boundary(face), to }),
        Decision::Stay(slack) => watch.rest(graph, labels, clusters, face, slack),
    };
    if due.len() <= 4 * CHUNK {
        due.iter().for_each(|&face| act(watch, face, decide(graph, labels, clusters, face)));
    } else {
        for due in due.chunks(batch()) {
            let decisions: Vec<Decision> =
                due.par_iter().with_min_len(CHUNK).map(|&face| decide(graph, labels, clusters, face)).collect();
            due.iter().zip(decisions).for_each(|(&face, decision)| act(watch, face, decision));
        }
    }
    let kept_back = leaving.kept_back(&wanted, clusters);
    if !kept_back.is_empty() {
        wanted.retain(|leaver| kept_back.binary_search(&leaver.face).is_err());
        kept_back.into_iter().for_each(|face| watch.kept_back(face));
    }
    wanted
}

/// Whether a face stays or wants to go: to the neighbouring cluster whose proxy is nearest, if that is nearer than its own's;
/// the smaller number where two are equally near.
fn decide(graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32) -> Decision {
    let from = labels.near_boundary(face);
    let centroid = graph.centroids[face as usize];
    let mut best = (u64::MAX, from);
    let mut last = from;
    for &near in graph.neighbours_of(face) {
        let cluster = labels.near_boundary(near);
        if cluster != from && cluster != last {
            best = best.min((clusters.squared_distance(centroid, cluster), cluster));
            last = cluster;
        }
    }
    let (distance, to) = best;
    let own = clusters.squared_distance(centroid, from);
    if distance < own { Decision::Move(to) } else { Decision::Stay(boundary_slack(own, distance)) }
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
