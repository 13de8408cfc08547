//! The boundary phase (P§3.2): one pass as [`crate::cluster::flat`] defines it, on active faces.

use super::active_faces::ActiveFaces;
use super::clusters::Clusters;
use super::nearby::{Bound, Rival};
use super::{Move, Partition};
use crate::energy::{Functional, Sums, boundary_slack};

/// What boundary phases keep between passes.
#[derive(Debug)]
pub struct BoundaryPhase {
    /// They have to know of moves and merges.
    pub active: ActiveFaces,
    /// For each cluster, how many faces want to leave it and the smallest of them; zero between passes.
    leaving: Vec<(u32, u32)>,
}

impl BoundaryPhase {
    /// All boundary faces are active.
    pub fn new<E: Functional>(partition: &Partition<'_, E>) -> Self {
        Self { active: ActiveFaces::new(partition), leaving: vec![(0, 0); partition.clusters.len()] }
    }

    /// The moves of a pass, given the clusters whose proxies changed since the last; none when the phase has converged.
    pub fn moves<E: Functional>(&mut self, partition: &mut Partition<'_, E>, changed: &[u32]) -> Vec<Move> {
        self.active.collect(partition, changed, rival);
        // 1. every face decides
        let mut moves = self.active.evaluate(partition, |face| decide(partition, face));
        // 2. the last face of a cluster stays, and decides again
        let last_faces = self.last_faces(&moves, &partition.clusters);
        if !last_faces.is_empty() {
            moves.retain(|leaving| last_faces.binary_search(&leaving.face).is_err());
            last_faces.into_iter().for_each(|face| self.active.add(face));
        }
        // 3. all others move
        moves
    }

    /// The smallest face of each cluster that all of its faces want to leave, sorted.
    fn last_faces<E: Functional>(&mut self, moves: &[Move], clusters: &Clusters<E>) -> Vec<u32> {
        for leaving in moves {
            let (count, smallest) = &mut self.leaving[leaving.from as usize];
            *smallest = if *count == 0 { leaving.face } else { leaving.face.min(*smallest) };
            *count += 1;
        }
        let mut last = Vec::new();
        for leaving in moves {
            let (count, smallest) = std::mem::take(&mut self.leaving[leaving.from as usize]);
            if count == clusters.sums(leaving.from).faces() {
                last.push(smallest);
            }
        }
        last.sort_unstable();
        last
    }
}

/// How a face that stays sees a cluster among its neighbours'.
fn rival<E: Functional>(
    Partition { graph, labels, clusters, .. }: &Partition<'_, E>,
    face: u32,
    cluster: u32,
) -> Rival {
    let point = graph.points[face as usize];
    let own = clusters.cached(labels.near_boundary(face)).cost(point);
    let other = clusters.cached(cluster).cost(point);
    (own <= other).then(|| boundary_slack(own, other))
}

/// The move of a face to the nearest cluster among its neighbours' (the smaller number of equally near ones), if that
/// is nearer than its own.
#[inline]
fn decide<E: Functional>(partition: &Partition<'_, E>, face: u32) -> (Option<Move>, Bound) {
    let Partition { graph, labels, clusters, .. } = partition;
    let from = labels.near_boundary(face);
    let point = graph.points[face as usize];
    let mut nearest = (i64::MAX.cast_unsigned(), from);
    let bound = Bound::of(partition, face, from, |cluster, cached| {
        nearest = nearest.min((cached.cost(point), cluster));
    });
    let (distance, to) = nearest;
    let own = clusters.cached(from).cost(point);
    if distance < own {
        (Some(Move { face, from, to }), Bound { limit: Bound::ACTIVE, ..bound.until_a_change() })
    } else {
        (None, bound.with_slack(boundary_slack(own, distance)))
    }
}
