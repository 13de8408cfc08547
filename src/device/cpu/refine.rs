//! Refinement: one iteration as [`crate::cluster::refinement`] defines it, on active faces.

use std::cmp::Reverse;

use super::active_faces::ActiveFaces;
use super::bids::{Bid, Bids};
use super::change_log::Cursor;
use super::nearby::{Bound, Rival, other_clusters};
use super::tuning::chunks::CLUSTERS;
use super::{Move, Partition};
use crate::energy::{Functional, RefinementSlack, Side, Sums};
use crate::parallel;

/// What refinement keeps between iterations.
#[derive(Debug)]
pub struct RefinementPhase {
    /// They have to know of moves and merges.
    pub active: ActiveFaces,
    bids: Bids,
}

impl RefinementPhase {
    /// All boundary faces are active.
    pub fn new<E: Functional>(partition: &Partition<'_, E>) -> Self {
        let bids = Bids::new(partition.graph.faces(), partition.clusters.len());
        Self { active: ActiveFaces::new(partition), bids }
    }

    /// Begins a phase: faces that were refused, or had a bid when the last phase was cut short, may bid again.
    pub fn begin(&mut self) {
        self.bids.end().into_iter().for_each(|face| self.active.add(face));
    }

    /// The moves of the next iteration, maybe none; None when there are no bids.
    pub fn moves<E: Functional>(&mut self, partition: &mut Partition<'_, E>) -> Option<Vec<Move>> {
        self.renew_bids(partition);
        if self.bids.is_empty() {
            return None;
        }
        let winners = self.bids.winners();
        let moves = improving(partition, &self.bids, &winners);
        self.bids.commit(&winners, &moves);
        Some(moves.concat())
    }

    /// Evaluates active faces, and returns all bids.
    pub fn renew_bids<E: Functional>(&mut self, partition: &mut Partition<'_, E>) -> &Bids {
        let changed = partition.clusters.change_log.take(Cursor::Refinement);
        // a bid depends on its clusters, also that of a face which lies on no boundary any more
        self.bids.at(&changed).for_each(|face| self.active.add(face));
        self.active.collect(partition, &changed, rival);
        let bids = &self.bids;
        let new_bids = self.active.evaluate(partition, |face| {
            let (bid, bound) = best_bid(partition, face);
            (bids.is_new(face, bid).then_some((face, bid)), bound)
        });
        new_bids.into_iter().for_each(|(face, bid)| self.bids.set(face, bid));
        &self.bids
    }
}

/// What moves for each winner: all that bid for its move if that lowers the energy, else the winner alone if that does.
fn improving<E: Functional>(
    Partition { graph, clusters, .. }: &Partition<'_, E>,
    bids: &Bids,
    winners: &[Move],
) -> Vec<Vec<Move>> {
    parallel::map(winners.len(), CLUSTERS, |nth| {
        let winner @ Move { face, from, to } = winners[nth];
        if clusters.improves(from, to, &graph.sums_over(bids.joining(winner).map(|moved| moved.face))) {
            bids.joining(winner).collect()
        } else if clusters.improves(from, to, &graph.sums_over([face])) {
            vec![winner]
        } else {
            Vec::new()
        }
    })
}

/// The bid of a face for the neighbouring cluster with the largest positive gain (the smaller number of equal ones),
/// and until when that holds.
#[inline]
fn best_bid<E: Functional>(partition: &Partition<'_, E>, face: u32) -> (Bid, Bound) {
    let Partition { graph, labels, clusters, .. } = partition;
    let from = labels.near_boundary(face);
    let point = graph.points[face as usize];
    let weight = graph.weights[face as usize];
    let own = clusters.cached(from);
    let mut slack = RefinementSlack::new(weight, own.cost(point), own.least_weight);
    let bound = Bound::of(partition, face, from, |_, other| {
        slack.other(other.cost(point), other.least_weight);
    });
    if slack.is_clear() || clusters.sums(from).faces() == 1 {
        return (Bid::default(), bound.with_slack(slack.get()));
    }
    let side = |cluster| Side { cost: clusters.cached(cluster).cost(point), weight: clusters.sums(cluster).weight() };
    let own = side(from);
    let gains = other_clusters(graph, labels, face, from).map(|to| (E::gain(weight, own, side(to)), Reverse(to)));
    match gains.max() {
        Some((gain, Reverse(to))) if gain > 0 => (Bid { gain: E::bid(gain, weight), from, to }, bound.until_a_change()),
        _ => (Bid::default(), bound.with_slack(0)),
    }
}

/// How a face without a bid sees a cluster among its neighbours'.
fn rival<E: Functional>(
    Partition { graph, labels, clusters, .. }: &Partition<'_, E>,
    face: u32,
    cluster: u32,
) -> Rival {
    let from = labels.near_boundary(face);
    let (point, weight) = (graph.points[face as usize], graph.weights[face as usize]);
    let [own, other] = [from, cluster].map(|cluster| clusters.cached(cluster));
    let mut slack = RefinementSlack::new(weight, own.cost(point), own.least_weight);
    slack.other(other.cost(point), other.least_weight);
    let [own, other] = [(from, own), (cluster, other)]
        .map(|(cluster, cached)| Side { cost: cached.cost(point), weight: clusters.sums(cluster).weight() });
    // a face that is alone in its cluster does not bid, until its cluster grows
    let is_alone = clusters.sums(from).faces() == 1;
    (slack.is_clear() || is_alone || E::gain(weight, own, other) <= 0).then(|| slack.get())
}
