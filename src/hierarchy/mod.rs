//! The result of a hierarchical clustering: merges, the faces that moved between them, and the rounds they came in.
//!
//! This is the stored form: [`Tree::labels_at`] replays it to any number of clusters without clustering again. A
//! cluster is named by the face it started from (a number of the upload), and keeps the name of one of the two when two
//! merge. A replay costs one step a merge and a move up to the cut, and one look-up a face at the end.
//!
//! | what | where |
//! |---|---|
//! | cuts | [`Tree::labels_at`], `replay` |
//! | the file it is kept in, `.tsr` | [`stored`] |
//! | JSON, for programs that walk the tree | [`json`] |
//! | scipy's linkage matrix | [`linkage`] |
//!
//! Nothing here knows of devices, surfaces or files of meshes.

pub mod json;
pub mod linkage;
mod replay;
pub mod stored;

use serde::Serialize;
use utoipa::ToSchema;

use self::replay::{CutPlan, Replay, check_range};
use crate::device::FREE;
use crate::energy::Merged;
use crate::error::{Error, Kind, Result};

/// A hierarchy of clusterings of the same faces, finest first.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tree {
    /// Number of faces: the number of clusters before the first round.
    pub faces: u32,
    /// All merges, round after round; within a round the cheapest first.
    pub merges: Vec<Merge>,
    /// The faces that belong elsewhere after a round's optimisation than after its merges, round after round.
    pub moves: Vec<FaceMove>,
    /// The rounds, in order.
    pub rounds: Vec<Round>,
}

/// Two clusters that became one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Merge {
    /// The cluster that goes on under its name.
    pub into: u32,
    /// The cluster that ends.
    pub from: u32,
    /// What it makes.
    pub made: Merged,
}

/// A face that the optimisation gave to another cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaceMove {
    /// The face, as a number of the upload.
    pub face: u32,
    /// The cluster it belongs to after the round.
    pub to: u32,
}

/// One round of merges and the optimisation after it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Round {
    /// Number of clusters after it.
    pub clusters: u32,
    /// Energy after it, source units.
    pub energy: f64,
    /// Where its merges end in [`Tree::merges`]; they begin where those of the round before end.
    pub merges_end: u32,
    /// Where its moves end in [`Tree::moves`].
    pub moves_end: u64,
}

impl Round {
    /// The round before the one at an index; zeros before the first.
    fn before(rounds: &[Self], round: usize) -> Self {
        round.checked_sub(1).map_or(Self::default(), |before| rounds[before])
    }
}

/// A round of a hierarchy, or several, each of which merged little.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Level {
    /// Number of the round, from 1; of several, the last.
    pub round: u32,
    /// Clusters left after it.
    pub clusters: u64,
    /// Energy after it with respect to the lattice proxies, source units. Null when it overflows.
    pub energy: Option<f64>,
    /// Pairs that merged since the row before.
    pub merges: u64,
    /// Faces that the optimisation gave to other clusters since the row before.
    pub moves: u64,
}

/// A clustering taken from a tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    /// One label a face, in upload order: 0 … K − 1, numbered by the first face that carries them.
    pub labels: Vec<u32>,
    /// Rounds replayed as a whole.
    pub rounds: u32,
    /// Merges of the next round applied on top, the cheapest ones; 0 when the cut is a state that the run had.
    pub extra_merges: u32,
    /// Energy of the cut, source units.
    pub energy: f64,
}

impl Cut {
    /// Number of clusters.
    pub fn clusters(&self) -> u64 {
        self.labels.iter().filter(|&&label| label != FREE).max().map_or(0, |&most| u64::from(most) + 1)
    }

    /// `exact` for a state that the run had, `merged` for one with merges of the next round on top.
    pub fn kind(&self) -> &'static str {
        if self.extra_merges == 0 { "exact" } else { "merged" }
    }
}

impl Tree {
    /// Number of clusters that the last round left: the roots.
    pub fn roots(&self) -> u32 {
        self.rounds.last().map_or(self.faces, |round| round.clusters)
    }

    /// Whether no face ever moved between clusters: each cluster is the union of its children.
    pub fn is_nested(&self) -> bool {
        self.moves.is_empty()
    }

    /// The labels at exactly `clusters` clusters.
    ///
    /// A number that a round ended with gives that round's state. Any other takes the state of the last round that
    /// left more, and applies as many of the next round's merges as it takes, the cheapest first.
    pub fn labels_at(&self, clusters: u64) -> Result<Cut> {
        let (plan, replay, energy) = self.replay_to(clusters)?;
        plan.finish(replay, energy)
    }

    /// Refuses a number of clusters that the tree cannot be cut at.
    pub fn check_cut(&self, clusters: u64) -> Result<()> {
        check_range(self.faces, self.roots(), clusters)
    }

    /// The replay of a cut, and the energy of the cut.
    fn replay_to(&self, clusters: u64) -> Result<(CutPlan, Replay, f64)> {
        self.check_cut(clusters)?;
        let plan = CutPlan::of(&self.rounds, self.faces, clusters as u32);
        let mut replay = Replay::new(self.faces);
        for round in 0..plan.rounds {
            self.replay(round, &mut replay)?;
        }
        let on_top = &self.merges[Round::before(&self.rounds, plan.rounds).merges_end as usize..][..plan.extra_merges];
        on_top.iter().try_for_each(|merge| replay.merge(merge.into, merge.from))?;
        Ok((plan, replay, on_top.iter().fold(plan.energy, |energy, merge| energy + merge.made.cost)))
    }

    /// The merges and the moves of a round.
    fn records_of(&self, round: usize) -> (&[Merge], &[FaceMove]) {
        let (before, after) = (Round::before(&self.rounds, round), &self.rounds[round]);
        (
            &self.merges[before.merges_end as usize..after.merges_end as usize],
            &self.moves[before.moves_end as usize..after.moves_end as usize],
        )
    }

    /// Does the merges and the moves of a round again.
    fn replay(&self, round: usize, replay: &mut Replay) -> Result<()> {
        let (merges, moves) = self.records_of(round);
        merges.iter().try_for_each(|merge| replay.merge(merge.into, merge.from))?;
        moves.iter().try_for_each(|moved| replay.give(*moved))
    }
}

/// The error of a hierarchy that cannot be one.
fn contradiction<T>(what: &str, value: impl std::fmt::Display) -> Result<T> {
    Err(Error::new(Kind::BadRequest, format_args!("the hierarchy contradicts itself: {what} {value}")))
}

/// The nodes of a tree as the merges make them: leaves are the faces, merge i makes node faces + i.
struct Nodes {
    /// The node that each living cluster is now; `u32::MAX` once it has ended.
    node_of_cluster: Vec<u32>,
    next: u32,
}

impl Nodes {
    fn new(faces: u32) -> Self {
        Self { node_of_cluster: (0..faces).collect(), next: faces }
    }

    /// Makes the node of the next merge: its number and its children's.
    fn merge(&mut self, merge: &Merge) -> (u32, [u32; 2]) {
        let from = std::mem::replace(&mut self.node_of_cluster[merge.from as usize], u32::MAX);
        let id = self.next;
        let into = std::mem::replace(&mut self.node_of_cluster[merge.into as usize], id);
        self.next += 1;
        (id, [into, from])
    }

    /// The nodes that have not been merged, ascending.
    fn roots(mut self) -> Vec<u32> {
        self.node_of_cluster.retain(|&node| node != u32::MAX);
        self.node_of_cluster.sort_unstable();
        self.node_of_cluster
    }
}

#[cfg(test)]
mod tests;
