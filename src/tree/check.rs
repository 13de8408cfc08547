//! Whether a tree that came from a file is one: every number within its range, every merge of living clusters.

use super::Tree;
use crate::error::{Error, Kind, Result};

impl Tree {
    /// An error that names the first contradiction, so that nothing else has to look for one.
    pub(super) fn check(&self) -> Result<()> {
        let faces = self.faces;
        if faces == 0 || faces > 1 << 31 {
            return contradiction("number of faces", faces);
        }
        if self.merges.len() >= faces as usize {
            return contradiction("number of merges", self.merges.len());
        }
        let ends = self.rounds.last().map_or((0, 0), |round| (round.merges_end as usize, round.moves_end));
        if ends != (self.merges.len(), self.moves.len() as u64) {
            return contradiction("rounds end before merges or moves do, round", self.rounds.len());
        }
        let mut lives = vec![true; faces as usize];
        let is_alive = |lives: &[bool], cluster: u32| lives.get(cluster as usize).copied().unwrap_or(false);
        let (mut merges_end, mut moves_end) = (0, 0);
        for (number, round) in self.rounds.iter().enumerate() {
            let merges = self.merges.get(merges_end..round.merges_end as usize);
            let moves = usize::try_from(round.moves_end).ok().and_then(|end| self.moves.get(moves_end..end));
            let (Some(merges), Some(moves)) = (merges, moves) else {
                return contradiction("ends of round", number + 1);
            };
            for (nth, merge) in merges.iter().enumerate() {
                let both = is_alive(&lives, merge.into) && is_alive(&lives, merge.from) && merge.into != merge.from;
                if !both || !(2..=faces).contains(&merge.faces) {
                    return contradiction("merge", merges_end + nth);
                }
                lives[merge.from as usize] = false;
            }
            if let Some(nth) = moves.iter().position(|moved| moved.face >= faces || !is_alive(&lives, moved.to)) {
                return contradiction("move", moves_end + nth);
            }
            merges_end += merges.len();
            moves_end += moves.len();
            if merges.is_empty() || round.clusters != faces - round.merges_end {
                return contradiction("clusters of round", number + 1);
            }
        }
        Ok(())
    }
}

fn contradiction<T>(what: &str, value: impl std::fmt::Display) -> Result<T> {
    Err(Error::new(Kind::BadRequest, format_args!("the hierarchy contradicts itself: {what} {value}")))
}
