//! The bids of refinement ([`crate::cluster::refinement`]): which faces would move where, and which of them win.
//!
//! Each cluster lists the faces that bid to leave or to enter it. Only a cluster whose bids changed can have a new
//! winner, so an iteration costs in proportion to those bids, not to all that are open.

use std::cmp::Reverse;

use super::Move;

/// No face, or no cluster.
const NONE: u32 = u32::MAX;

/// By how much a face would lower the energy, and where it would go.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bid {
    /// Packed gain ([`crate::energy::Functional::bid`]): larger is better; 0 for no bid.
    pub gain: u32,
    pub from: u32,
    pub to: u32,
}

impl Bid {
    /// The clusters of the bid; twice [`NONE`] for no bid.
    fn ends(self) -> [u32; 2] {
        if self.gain > 0 { [self.from, self.to] } else { [NONE; 2] }
    }
}

/// All open bids.
#[derive(Debug)]
pub struct Bids {
    bid_of_face: Vec<Bid>,
    /// Number of open bids.
    open: usize,
    /// Every face that has a bid, and some that had one in this phase.
    bidders: Vec<u32>,
    /// The faces that bid to leave or to enter each cluster, each once.
    at_cluster: Vec<Vec<u32>>,
    /// The face with the best of those bids, or [`NONE`]; out of date for clusters in `changed`.
    best: Vec<u32>,
    /// Clusters whose bids changed, some several times.
    changed: Vec<u32>,
    /// The faces that were refused since the phase began.
    refused: Vec<u32>,
}

impl Bids {
    /// No bids.
    pub fn new(faces: usize, clusters: usize) -> Self {
        Self {
            bid_of_face: vec![Bid::default(); faces],
            open: 0,
            bidders: Vec::new(),
            at_cluster: vec![Vec::new(); clusters],
            best: vec![NONE; clusters],
            changed: Vec::new(),
            refused: Vec::new(),
        }
    }

    /// Removes all bids. Returns the faces that had one, and those that were refused since the last call.
    pub fn end(&mut self) -> Vec<u32> {
        let mut faces = std::mem::take(&mut self.refused);
        for face in std::mem::take(&mut self.bidders) {
            if self.bid_of_face[face as usize].gain > 0 {
                self.set(face, Bid::default());
                faces.push(face);
            }
        }
        faces
    }

    /// Whether there are no bids.
    pub fn is_empty(&self) -> bool {
        self.open == 0
    }

    /// The faces that bid to leave or to enter some clusters, some of them twice.
    pub fn at<'a>(&'a self, clusters: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        clusters.iter().flat_map(|&cluster| &self.at_cluster[cluster as usize]).copied()
    }

    /// Whether a bid differs from the one that the face has.
    pub fn is_new(&self, face: u32, bid: Bid) -> bool {
        let old = self.bid_of_face[face as usize];
        old != bid && (old.gain > 0 || bid.gain > 0)
    }

    /// Replaces the bid of a face.
    pub fn set(&mut self, face: u32, new: Bid) {
        if !self.is_new(face, new) {
            return;
        }
        let old = std::mem::replace(&mut self.bid_of_face[face as usize], new);
        let ends = old.ends().into_iter().chain(new.ends());
        self.changed.extend(ends.filter(|&cluster| cluster != NONE));
        for cluster in new.ends() {
            if cluster != NONE && !old.ends().contains(&cluster) {
                self.at_cluster[cluster as usize].push(face);
            }
        }
        if old.gain == 0 {
            self.bidders.push(face);
            self.open += 1;
        } else if new.gain == 0 {
            self.open -= 1;
        }
        for cluster in old.ends() {
            if cluster != NONE && !new.ends().contains(&cluster) {
                let listed = &mut self.at_cluster[cluster as usize];
                if let Some(at) = listed.iter().position(|&other| other == face) {
                    listed.swap_remove(at);
                }
            }
        }
    }

    /// The bids that are the best at both their clusters and were not before, as moves.
    pub fn winners(&mut self) -> Vec<Move> {
        let mut changed = std::mem::take(&mut self.changed);
        changed.sort_unstable();
        changed.dedup();
        for &cluster in &changed {
            let rank = |&face: &u32| (self.bid_of_face[face as usize].gain, Reverse(face));
            let best = self.at_cluster[cluster as usize].iter().copied().max_by_key(rank);
            self.best[cluster as usize] = best.unwrap_or(NONE);
        }
        let mut winners = Vec::new();
        for &cluster in &changed {
            let face = self.best[cluster as usize];
            if face == NONE {
                continue;
            }
            let Bid { from, to, .. } = self.bid_of_face[face as usize];
            let other = if cluster == from { to } else { from };
            // a winner that is new to both its clusters is found once, from the one that it leaves
            if self.best[other as usize] == face && (cluster == from || changed.binary_search(&other).is_err()) {
                winners.push(Move { face, from, to });
            }
        }
        winners
    }

    /// All faces that bid for the move of a winner.
    pub fn joining(&self, winner: Move) -> impl Iterator<Item = Move> + '_ {
        // a bid is listed at both its clusters
        let [from, to] = [winner.from, winner.to].map(|cluster| &self.at_cluster[cluster as usize]);
        let shorter = if from.len() <= to.len() { from } else { to };
        let joins = move |face: &&u32| self.bid_of_face[**face as usize].ends() == [winner.from, winner.to];
        shorter.iter().filter(joins).map(move |&face| Move { face, ..winner })
    }

    /// Takes the bids of winners, and of the faces that move with each, out. A winner without moves is refused.
    pub fn commit(&mut self, winners: &[Move], moves: &[Vec<Move>]) {
        for (winner, moves) in winners.iter().zip(moves) {
            if moves.is_empty() {
                self.refused.push(winner.face);
            }
            for moved in moves.iter().chain([winner]) {
                self.set(moved.face, Bid::default());
            }
        }
    }
}
