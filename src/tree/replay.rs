//! Cuts: the merges and moves of a run, done again as far as it takes.

use super::{Cut, FaceMove, Round, contradiction};
use crate::error::{Error, Result};

/// Refuses numbers of clusters that a hierarchy does not have.
pub(super) fn check_range(faces: u32, roots: u32, clusters: u64) -> Result<()> {
    if clusters > u64::from(faces) || clusters < u64::from(roots) {
        return Err(Error::parameter(format_args!(
            "clusters must be between the {roots} that the hierarchy ends with and its {faces} faces: {clusters}"
        )));
    }
    Ok(())
}

/// How far a replay goes for a cut.
#[derive(Debug, Clone, Copy)]
pub(super) struct CutPlan {
    clusters: u32,
    /// Rounds that are replayed as a whole.
    rounds: u32,
    /// Their merges.
    merges: usize,
    /// Their moves.
    pub moves: usize,
    /// Merges of the next round on top.
    extra_merges: u32,
    /// Energy after the rounds.
    energy: f64,
}

impl CutPlan {
    /// For a number of clusters that the rounds have.
    pub fn of(rounds: &[Round], faces: u32, clusters: u32) -> Self {
        let whole = rounds.partition_point(|round| round.clusters >= clusters);
        let start = Round { clusters: faces, energy: 0.0, merges_end: 0, moves_end: 0 };
        let last = whole.checked_sub(1).map_or(start, |last| rounds[last]);
        Self {
            clusters,
            rounds: whole as u32,
            merges: last.merges_end as usize,
            moves: last.moves_end as usize,
            extra_merges: last.clusters - clusters,
            energy: last.energy,
        }
    }

    /// All merges that are replayed.
    pub fn merges(&self) -> usize {
        self.merges + self.extra_merges as usize
    }
}

/// A replay of merges and moves. Merges come in order, as do moves; the two need not be in step, because a move names a
/// cluster by what it was when the round ended, and that cluster's later merges hold for the face too.
#[derive(Debug)]
pub(super) struct Replay {
    plan: CutPlan,
    energy: f64,
    merged: usize,
    /// What each cluster has become part of; itself while it lives.
    parent: Vec<u32>,
    cluster_of_face: Vec<u32>,
}

impl Replay {
    pub fn new(faces: u32, plan: CutPlan) -> Self {
        Self {
            plan,
            energy: plan.energy,
            merged: 0,
            parent: (0..faces).collect(),
            cluster_of_face: (0..faces).collect(),
        }
    }

    /// A merge of two living clusters.
    pub fn merge(&mut self, into: u32, from: u32, cost: f64) -> Result<()> {
        let lives = |cluster: u32| self.parent.get(cluster as usize) == Some(&cluster);
        if !lives(into) || !lives(from) || into == from {
            return contradiction("merge", self.merged);
        }
        self.parent[from as usize] = into;
        if self.merged >= self.plan.merges {
            self.energy += cost;
        }
        self.merged += 1;
        Ok(())
    }

    pub fn give(&mut self, FaceMove { face, to }: FaceMove) -> Result<()> {
        match self.cluster_of_face.get_mut(face as usize) {
            Some(cluster) if (to as usize) < self.parent.len() => {
                *cluster = to;
                Ok(())
            }
            _ => contradiction("move of face", face),
        }
    }

    pub fn finish(mut self) -> Result<Cut> {
        let CutPlan { clusters, rounds, extra_merges, .. } = self.plan;
        let mut number_of_cluster = vec![u32::MAX; self.parent.len()];
        let mut seen = 0;
        for label in &mut self.cluster_of_face {
            let number = &mut number_of_cluster[root(&mut self.parent, *label) as usize];
            if *number == u32::MAX {
                *number = seen;
                seen += 1;
            }
            *label = *number;
        }
        if seen != clusters {
            return contradiction("clusters with faces", format_args!("{seen} of {clusters}"));
        }
        Ok(Cut { labels: self.cluster_of_face, rounds, extra_merges, energy: self.energy })
    }
}

/// The cluster that a cluster has become; halves the path on the way.
fn root(parent: &mut [u32], mut cluster: u32) -> u32 {
    loop {
        let up = parent[cluster as usize];
        if up == cluster {
            return cluster;
        }
        let above = parent[up as usize];
        parent[cluster as usize] = above;
        cluster = above;
    }
}
