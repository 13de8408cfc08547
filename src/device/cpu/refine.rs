//! Refinement: the iteration of bids and exact acceptance that [`crate::cluster::refinement`] defines.

use rayon::prelude::*;

use super::clusters::{Change, Clusters};
use super::frontier::Frontier;
use super::labels::Labels;
use super::{CHUNK, Move};
use crate::cluster::refinement::{Side, bid, gain};
use crate::surface::DualGraph;

/// No bid, no exchange.
const NONE: u32 = u32::MAX;

/// A face that would lower the energy by moving.
#[derive(Debug, Clone, Copy)]
struct Bid {
    /// Packed gain: larger is better.
    gain: u32,
    wish: Move,
}

/// A winning bid and the faces that make the same move.
#[derive(Debug)]
struct Exchange {
    winner: Move,
    together: Change,
    verdict: Verdict,
}

/// What comes of an exchange.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    AllMove,
    WinnerMoves,
    Refused,
}

/// The bids of a phase.
#[derive(Debug)]
pub struct Bids {
    /// Every face that would improve and was not refused since it last had to look.
    open: Vec<Bid>,
    /// Of each cluster the index of its best bid, then of the exchange it takes part in; [`NONE`] between iterations.
    chosen: Vec<u32>,
    exchanges: Vec<Exchange>,
    /// The faces that were refused since the phase began.
    refused: Vec<u32>,
}

impl Bids {
    /// No bids yet.
    pub fn new(clusters: usize) -> Self {
        Self { open: Vec::new(), chosen: vec![NONE; clusters], exchanges: Vec::new(), refused: Vec::new() }
    }

    /// The faces that were refused in the last phase; in the next, they may bid again.
    pub fn take_refused(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.refused)
    }

    /// Whether nobody would improve.
    pub fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// Lets the faces that are due bid anew; the other bids stand.
    pub fn renew(&mut self, graph: &DualGraph, labels: &Labels, clusters: &Clusters, due: &[u32], frontier: &Frontier) {
        let bids: Vec<Bid> = due
            .par_chunks(CHUNK)
            .flat_map_iter(|faces| faces.iter().filter_map(|&face| best_move(graph, labels, clusters, face)))
            .collect();
        self.open.retain(|bid| !frontier.was_due(bid.wish.face));
        self.open.extend(bids);
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
        let (chosen, exchanges, refused) = (&self.chosen, &self.exchanges, &mut self.refused);
        self.open.retain(|&Bid { wish, .. }| {
            let Some(exchange) = joined(chosen, exchanges, wish) else { return true };
            let exchange = &exchanges[exchange];
            let is_winner = exchange.winner.face == wish.face;
            let moves_now = match exchange.verdict {
                Verdict::AllMove => true,
                Verdict::WinnerMoves => is_winner,
                Verdict::Refused => false,
            };
            if moves_now {
                moves.push(wish);
            } else if is_winner {
                refused.push(wish.face);
            }
            !is_winner && !moves_now
        });
        for exchange in self.exchanges.drain(..) {
            self.chosen[exchange.winner.from as usize] = NONE;
            self.chosen[exchange.winner.to as usize] = NONE;
        }
        moves
    }

    /// Opens an exchange for each bid that is the best at both its clusters.
    fn pair_up(&mut self) {
        let Self { open, chosen, exchanges, .. } = self;
        let rank = |index: u32| {
            let bid = &open[index as usize];
            (bid.gain, std::cmp::Reverse(bid.wish.face))
        };
        for index in 0..open.len() as u32 {
            let Move { from, to, .. } = open[index as usize].wish;
            for cluster in [from, to] {
                let best = &mut chosen[cluster as usize];
                if *best == NONE || rank(index) > rank(*best) {
                    *best = index;
                }
            }
        }
        for (index, bid) in open.iter().enumerate() {
            let Move { from, to, .. } = bid.wish;
            if [from, to].iter().all(|&cluster| chosen[cluster as usize] as usize == index) {
                exchanges.push(Exchange { winner: bid.wish, together: Change::default(), verdict: Verdict::Refused });
            }
        }
        for bid in open.iter() {
            chosen[bid.wish.from as usize] = NONE;
            chosen[bid.wish.to as usize] = NONE;
        }
        for (index, exchange) in exchanges.iter().enumerate() {
            chosen[exchange.winner.from as usize] = index as u32;
            chosen[exchange.winner.to as usize] = index as u32;
        }
    }

    /// Tests each exchange with all who make the move, then with the winner alone.
    fn judge(&mut self, graph: &DualGraph, clusters: &Clusters) {
        for bid in &self.open {
            if let Some(exchange) = joined(&self.chosen, &self.exchanges, bid.wish) {
                self.exchanges[exchange].together.add(graph, bid.wish.face);
            }
        }
        for Exchange { winner, together, verdict } in &mut self.exchanges {
            let alone = Change::of(graph, winner.face);
            *verdict = if clusters.improves(winner.from, winner.to, together) {
                Verdict::AllMove
            } else if clusters.improves(winner.from, winner.to, &alone) {
                Verdict::WinnerMoves
            } else {
                Verdict::Refused
            };
        }
    }

    /// Tests each exchange with the winner alone.
    fn judge_alone(&mut self, graph: &DualGraph, clusters: &Clusters, may_leave: &mut dyn FnMut(Move) -> bool) {
        for Exchange { winner, verdict, .. } in &mut self.exchanges {
            let improves = clusters.improves(winner.from, winner.to, &Change::of(graph, winner.face));
            *verdict = if improves && may_leave(*winner) { Verdict::WinnerMoves } else { Verdict::Refused };
        }
    }
}

/// The exchange that makes the move a face wishes for.
fn joined(chosen: &[u32], exchanges: &[Exchange], wish: Move) -> Option<usize> {
    let exchange = chosen[wish.from as usize] as usize;
    let winner = exchanges.get(exchange)?.winner;
    ((winner.from, winner.to) == (wish.from, wish.to)).then_some(exchange)
}

/// The bid of a face: for the neighbouring cluster with the largest positive gain, the smaller number of equal ones.
fn best_move(graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32) -> Option<Bid> {
    let from = labels.near_boundary(face);
    if clusters.sums(from).faces == 1 {
        return None;
    }
    let centroid = graph.centroids[face as usize];
    let weight = graph.weights[face as usize];
    let side = |cluster| Side {
        squared_distance: clusters.squared_distance(centroid, cluster),
        weight: clusters.sums(cluster).weight as u64,
    };
    let own = side(from);
    let mut best: Option<(i64, std::cmp::Reverse<u32>)> = None;
    let mut last = from;
    for &neighbour in graph.neighbours_of(face) {
        let to = labels.near_boundary(neighbour);
        if to != from && to != last {
            let offer = Some((gain(weight, own, side(to)), std::cmp::Reverse(to)));
            best = best.max(offer);
            last = to;
        }
    }
    let (gain, std::cmp::Reverse(to)) = best?;
    (gain > 0).then(|| Bid { gain: bid(gain, weight), wish: Move { face, from, to } })
}
