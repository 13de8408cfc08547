//! Whether a tree that came from a file is one: every number within its range, every merge of living clusters.

use super::{Round, Tree, contradiction};
use crate::error::Result;

impl Tree {
    /// An error that names the first contradiction, so that nothing else has to look for one.
    pub(super) fn check(&self) -> Result<()> {
        let faces = self.faces;
        check_rounds(faces, self.merges.len() as u64, self.moves.len() as u64, &self.rounds)?;
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
        }
        Ok(())
    }
}

/// Whether rounds cover so many merges and moves, each some merges, and leave the clusters that they should.
pub(super) fn check_rounds(faces: u32, merges: u64, moves: u64, rounds: &[Round]) -> Result<()> {
    if faces == 0 || faces > 1 << 31 {
        return contradiction("number of faces", faces);
    }
    if merges >= u64::from(faces) {
        return contradiction("number of merges", merges);
    }
    let mut ends = (0, 0);
    for (number, round) in rounds.iter().enumerate() {
        let is_later = round.merges_end > ends.0 && round.moves_end >= ends.1;
        if !is_later || u64::from(round.merges_end) > merges || round.clusters != faces - round.merges_end {
            return contradiction("round", number + 1);
        }
        ends = (round.merges_end, round.moves_end);
    }
    if (u64::from(ends.0), ends.1) != (merges, moves) {
        return contradiction("rounds end before merges or moves do, round", rounds.len());
    }
    Ok(())
}
