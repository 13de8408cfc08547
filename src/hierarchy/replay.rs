//! Cuts: the merges and moves of a run, done again as far as it takes.

use super::{Cut, FaceMove, Round, contradiction};
use crate::error::names::Name;
use crate::error::{Error, Result};
use crate::union_find::root;

/// Refuses numbers of clusters that a hierarchy does not have.
pub(super) fn check_range(faces: u32, roots: u32, clusters: u64) -> Result<()> {
    if clusters > u64::from(faces) || clusters < u64::from(roots) {
        return Err(Error::parameter(format_args!(
            "{} must be between the {roots} that the hierarchy ends with and the {faces} that it begins with: \
             {clusters}",
            Name::CLUSTERS
        )));
    }
    Ok(())
}

/// How far a replay goes for a cut.
#[derive(Debug, Clone, Copy)]
pub(super) struct CutPlan {
    clusters: u32,
    /// Rounds that are replayed as a whole.
    pub rounds: usize,
    /// Merges of the next round on top.
    pub extra_merges: usize,
    /// Energy after the rounds.
    pub energy: f64,
}

impl CutPlan {
    /// For a number of clusters that the rounds have.
    pub fn of(rounds: &[Round], faces: u32, clusters: u32) -> Self {
        let whole = rounds.partition_point(|round| round.clusters >= clusters);
        let last = whole.checked_sub(1).map_or(Round { clusters: faces, ..Round::default() }, |last| rounds[last]);
        Self { clusters, rounds: whole, extra_merges: (last.clusters - clusters) as usize, energy: last.energy }
    }

    /// The cut, when all of it was replayed; its energy is that after the rounds and the costs of the merges on top.
    pub fn finish(self, replay: Replay, energy: f64) -> Result<Cut> {
        let (labels, clusters) = replay.into_labels();
        if clusters != self.clusters {
            return contradiction("clusters with faces", format_args!("{clusters} of {}", self.clusters));
        }
        Ok(Cut { labels, rounds: self.rounds as u32, extra_merges: self.extra_merges as u32, energy })
    }
}

/// A cluster that ended before the replay began.
const GONE: u32 = u32::MAX;

/// A replay of the merges and moves of the rounds, in order. Every record is checked.
#[derive(Debug)]
pub(super) struct Replay {
    merged: usize,
    /// What each cluster has become part of; itself while it lives, [`GONE`] where it is not known.
    parent: Vec<u32>,
    cluster_of_face: Vec<u32>,
}

impl Replay {
    /// From the start, where every face is a cluster.
    pub fn new(faces: u32) -> Self {
        Self { merged: 0, parent: (0..faces).collect(), cluster_of_face: (0..faces).collect() }
    }

    /// From the state after a round, in which each face is in this cluster.
    pub fn starting_from(cluster_of_face: Vec<u32>, round: &Round) -> Result<Self> {
        let mut parent = vec![GONE; cluster_of_face.len()];
        let mut clusters = 0;
        for &cluster in &cluster_of_face {
            match parent.get_mut(cluster as usize) {
                Some(parent) if *parent == GONE => {
                    *parent = cluster;
                    clusters += 1;
                }
                Some(_) => {}
                None => return contradiction("cluster in a checkpoint", cluster),
            }
        }
        if clusters != round.clusters {
            return contradiction("clusters in a checkpoint", clusters);
        }
        Ok(Self { merged: round.merges_end as usize, parent, cluster_of_face })
    }

    /// Whether a cluster has not become part of another.
    fn lives(&self, cluster: u32) -> bool {
        self.parent.get(cluster as usize) == Some(&cluster)
    }

    /// A merge of two living clusters.
    pub fn merge(&mut self, into: u32, from: u32) -> Result<()> {
        if !self.lives(into) || !self.lives(from) || into == from {
            return contradiction("merge", self.merged);
        }
        self.parent[from as usize] = into;
        self.merged += 1;
        Ok(())
    }

    /// A move of a face to a living cluster.
    pub fn give(&mut self, FaceMove { face, to }: FaceMove) -> Result<()> {
        let lives = self.lives(to);
        match self.cluster_of_face.get_mut(face as usize).filter(|_| lives) {
            Some(cluster) => {
                *cluster = to;
                Ok(())
            }
            None => contradiction("move of face", face),
        }
    }

    /// The living cluster that each face is in.
    pub fn clusters(&mut self) -> &[u32] {
        for cluster in &mut self.cluster_of_face {
            *cluster = root(&mut self.parent, *cluster);
        }
        &self.cluster_of_face
    }

    /// Clusters numbered by the first face that is in them, for each face, and how many there are.
    fn into_labels(mut self) -> (Vec<u32>, u32) {
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
        (self.cluster_of_face, seen)
    }
}
