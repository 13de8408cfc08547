//! Refinement: the iteration of bids and exact acceptance that [`crate::cluster::refinement`] defines.
//!
//! A cluster keeps the faces that bid to leave or to enter it. Only clusters whose bids changed can win anything they did not
//! win before, so an iteration costs in proportion to those: where the tail of a phase moves ten faces an iteration, it looks
//! at some hundred bids, not at all that are open.

use rayon::prelude::*;

use super::clusters::{Change, Clusters};
use super::labels::Labels;
use super::watch::{Answer, RefinementSlack, Resting, Seen, Watch, others_beside};
use super::{CHUNK, Move};
use crate::cluster::refinement::{Side, bid, gain};
use crate::surface::DualGraph;

/// No face.
const NONE: u32 = u32::MAX;

/// What a face would lower the energy by, and where it would go.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Bid {
    /// Packed gain: larger is better; 0 for no bid.
    gain: u32,
    from: u32,
    to: u32,
}

impl Bid {
    /// Whether it is another bid, or one and none.
    fn differs(self, other: Self) -> bool {
        self != other && (self.gain > 0 || other.gain > 0)
    }
}

/// A winning bid.
#[derive(Debug)]
struct Exchange {
    winner: Move,
    verdict: Verdict,
}

/// What comes of an exchange.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    AllMove,
    WinnerMoves,
    Refused,
}

/// The bids of a phase. Empty until somebody is asked for one.
#[derive(Debug, Default)]
pub struct Bids {
    bid_of_face: Vec<Bid>,
    /// Number of bids.
    open: usize,
    /// Every face that has a bid, and some that had one in this phase.
    bidders: Vec<u32>,
    /// The faces that bid to leave or to enter each cluster, each once.
    at_cluster: Vec<Vec<u32>>,
    /// The best of them, or [`NONE`]; wrong for clusters whose bids changed.
    best: Vec<u32>,
    /// Clusters whose bids changed, and whether each is among them.
    changed: Vec<u32>,
    is_changed: Vec<bool>,
    exchanges: Vec<Exchange>,
    /// The faces that were refused since the phase began.
    refused: Vec<u32>,
}

impl Bids {
    /// Ends the last phase, when another begins. Returns the faces that were refused in it, or still have bids because it
    /// was cut short: they may bid again. Nobody has a bid any more: what happened since did not renew them.
    pub fn end(&mut self) -> Vec<u32> {
        let mut waiting = std::mem::take(&mut self.refused);
        for face in std::mem::take(&mut self.bidders) {
            if self.bid_of_face[face as usize].gain > 0 {
                self.place(face, Bid::default());
                waiting.push(face);
            }
        }
        waiting
    }

    /// Whether nobody would improve.
    pub fn is_empty(&self) -> bool {
        self.open == 0
    }

    /// The faces that bid to leave or to enter some clusters, some of them maybe twice. When those change they must bid anew, also
    /// where they see nobody any more.
    pub fn at<'a>(&'a self, clusters: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        clusters.iter().filter_map(|&cluster| self.at_cluster.get(cluster as usize)).flatten().copied()
    }

    /// Lets the faces that are due bid anew; the other bids stand. Those that do not bid rest.
    pub fn renew(&mut self, graph: &DualGraph, labels: &Labels, clusters: &Clusters, watch: &mut Watch) {
        self.bid_of_face.resize(graph.faces(), Bid::default());
        self.at_cluster.resize_with(clusters.len(), Vec::new);
        self.best.resize(clusters.len(), NONE);
        self.is_changed.resize(clusters.len(), false);
        let news = watch.ask(graph, labels, |face| {
            let (bid, rest) = best_move(graph, labels, clusters, face);
            let is_news = bid.differs(self.bid_of_face[face as usize]);
            Answer { wish: is_news.then_some((face, bid)), rest }
        });
        news.into_iter().for_each(|(face, bid)| self.place(face, bid));
    }

    /// Replaces the bid of a face.
    fn place(&mut self, face: u32, new: Bid) {
        let old = std::mem::replace(&mut self.bid_of_face[face as usize], new);
        if !old.differs(new) {
            return;
        }
        let ends = |bid: Bid| if bid.gain > 0 { [bid.from, bid.to] } else { [NONE; 2] };
        for cluster in ends(old) {
            self.note(cluster);
        }
        for cluster in ends(new) {
            self.note(cluster);
            if cluster != NONE && !ends(old).contains(&cluster) {
                self.at_cluster[cluster as usize].push(face);
            }
        }
        if old.gain == 0 {
            self.bidders.push(face);
            self.open += 1;
        } else if new.gain == 0 {
            self.open -= 1;
        }
        // nobody is listed where it does not bid: a later bid would list it twice
        for cluster in ends(old) {
            if cluster != NONE && !ends(new).contains(&cluster) {
                let listed = &mut self.at_cluster[cluster as usize];
                if let Some(place) = listed.iter().position(|&other| other == face) {
                    listed.swap_remove(place);
                }
            }
        }
    }

    /// The bids at a cluster changed.
    fn note(&mut self, cluster: u32) {
        if cluster != NONE && !std::mem::replace(&mut self.is_changed[cluster as usize], true) {
            self.changed.push(cluster);
        }
    }

    /// The moves of an iteration; none when all winners are refused. Winners leave the bids, whether they move or not.
    ///
    /// `may_leave` is asked of a winner that would have to move alone; where it is given, nobody joins a winner.
    pub fn moves(
        &mut self,
        graph: &DualGraph,
        clusters: &Clusters,
        may_leave: Option<&mut dyn FnMut(Move) -> bool>,
    ) -> Vec<Move> {
        self.pair_up();
        match may_leave {
            None => self.judge(graph, clusters),
            Some(may_leave) => self.judge_alone(graph, clusters, may_leave),
        }
        let mut moves = Vec::new();
        for Exchange { winner, verdict } in std::mem::take(&mut self.exchanges) {
            let first = moves.len();
            match verdict {
                Verdict::AllMove => moves.extend(self.together(winner)),
                Verdict::WinnerMoves => moves.push(winner),
                Verdict::Refused => self.refused.push(winner.face),
            }
            self.place(winner.face, Bid::default());
            for moved in &moves[first..] {
                self.place(moved.face, Bid::default());
            }
        }
        moves
    }

    /// All that bid for the move of the winner.
    fn together(&self, winner: Move) -> impl Iterator<Item = Move> + '_ {
        // whoever leaves for a cluster is listed at both
        let [from, to] = [winner.from, winner.to].map(|cluster| &self.at_cluster[cluster as usize]);
        let shorter = if from.len() <= to.len() { from } else { to };
        let makes_the_move = move |face: &&u32| {
            let bid = self.bid_of_face[**face as usize];
            (bid.from, bid.to) == (winner.from, winner.to)
        };
        shorter.iter().filter(makes_the_move).map(move |&face| Move { face, ..winner })
    }

    /// Opens an exchange for each bid that is the best at both its clusters. One that was not before is the best of a
    /// cluster whose bids changed.
    fn pair_up(&mut self) {
        for &cluster in &self.changed {
            let rank = |&face: &u32| (self.bid_of_face[face as usize].gain, std::cmp::Reverse(face));
            let best = self.at_cluster[cluster as usize].iter().copied().max_by_key(rank);
            self.best[cluster as usize] = best.unwrap_or(NONE);
        }
        for &cluster in &self.changed {
            let face = self.best[cluster as usize];
            if face == NONE {
                continue;
            }
            let Bid { from, to, .. } = self.bid_of_face[face as usize];
            let other = if cluster == from { to } else { from };
            // where both changed, the one that is left speaks for both
            if self.best[other as usize] == face && (cluster == from || !self.is_changed[other as usize]) {
                self.exchanges.push(Exchange { winner: Move { face, from, to }, verdict: Verdict::Refused });
            }
        }
        for cluster in self.changed.drain(..) {
            self.is_changed[cluster as usize] = false;
        }
    }

    /// Tests each exchange with all who make the move, then with the winner alone.
    fn judge(&mut self, graph: &DualGraph, clusters: &Clusters) {
        let mut exchanges = std::mem::take(&mut self.exchanges);
        let judge = |Exchange { winner, verdict }: &mut Exchange| {
            let alone = Change::of(graph, winner.face);
            let mut together = Change::default();
            self.together(*winner).for_each(|moved| together.add(graph, moved.face));
            *verdict = if clusters.improves(winner.from, winner.to, &together) {
                Verdict::AllMove
            } else if clusters.improves(winner.from, winner.to, &alone) {
                Verdict::WinnerMoves
            } else {
                Verdict::Refused
            };
        };
        if exchanges.len() <= CHUNK {
            exchanges.iter_mut().for_each(judge);
        } else {
            exchanges.par_iter_mut().with_min_len(CHUNK / 8).for_each(judge);
        }
        self.exchanges = exchanges;
    }

    /// Tests each exchange with the winner alone.
    fn judge_alone(&mut self, graph: &DualGraph, clusters: &Clusters, may_leave: &mut dyn FnMut(Move) -> bool) {
        for Exchange { winner, verdict } in &mut self.exchanges {
            let improves = clusters.improves(winner.from, winner.to, &Change::of(graph, winner.face));
            *verdict = if improves && may_leave(*winner) { Verdict::WinnerMoves } else { Verdict::Refused };
        }
    }
}

/// The bid of a face: for the neighbouring cluster with the largest positive gain, the smaller number of equal ones. And how
/// long it will not bid otherwise.
fn best_move(graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32) -> (Bid, Resting) {
    let from = labels.near_boundary(face);
    let centroid = graph.centroids[face as usize];
    let weight = graph.weights[face as usize];
    let own = clusters.place(from);
    let mut slack = RefinementSlack::new(weight, own.squared_distance(centroid), own.least_weight);
    let seen = Seen::around(graph, labels, clusters, face, from, |_, place| {
        slack.beside(place.squared_distance(centroid), place.least_weight);
    });
    if slack.is_clear() || clusters.sums(from).faces == 1 {
        return (Bid::default(), seen.rest(slack.get()));
    }
    let side = |cluster| Side {
        squared_distance: clusters.place(cluster).squared_distance(centroid),
        weight: clusters.sums(cluster).weight as u64,
    };
    let own = side(from);
    let mut best: Option<(i64, std::cmp::Reverse<u32>)> = None;
    for to in others_beside(graph, labels, face, from) {
        best = best.max(Some((gain(weight, own, side(to)), std::cmp::Reverse(to))));
    }
    let bid = match best {
        Some((gain, std::cmp::Reverse(to))) if gain > 0 => Bid { gain: bid(gain, weight), from, to },
        _ => Bid::default(),
    };
    (bid, seen.rest(0))
}
