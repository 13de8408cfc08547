//! Boundary-based optimisation (P§3.2): the synchronous iteration that [`crate::cluster`] defines.

use super::Move;
use super::clusters::Clusters;
use super::labels::Labels;
use super::watch::{Answer, Seen, Watch, boundary_slack};
use crate::surface::DualGraph;

/// The moves that the faces that are due want and the last-face rule allows; the others rest.
pub fn moves(
    graph: &DualGraph,
    labels: &Labels,
    clusters: &Clusters,
    watch: &mut Watch,
    leaving: &mut Leaving,
) -> Vec<Move> {
    let mut wanted = watch.ask(graph, labels, |face| decide(graph, labels, clusters, face));
    let kept_back = leaving.kept_back(&wanted, clusters);
    if !kept_back.is_empty() {
        wanted.retain(|leaver| kept_back.binary_search(&leaver.face).is_err());
        kept_back.into_iter().for_each(|face| watch.add(face));
    }
    wanted
}

/// Whether a face stays or wants to go: to the neighbouring cluster whose proxy is nearest, if that is nearer than its own's;
/// the smaller number where two are equally near.
fn decide(graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32) -> Answer<Move> {
    let from = labels.near_boundary(face);
    let centroid = graph.centroids[face as usize];
    let mut best = (i64::MAX.cast_unsigned(), from);
    let seen = Seen::around(graph, labels, clusters, face, from, |cluster, place| {
        best = best.min((place.squared_distance(centroid), cluster));
    });
    let (distance, to) = best;
    let own = clusters.place(from).squared_distance(centroid);
    if distance < own {
        Answer { wish: Some(Move { face, from, to }), rest: seen.due() }
    } else {
        Answer { wish: None, rest: seen.rest(boundary_slack(own, distance)) }
    }
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
