//! Paying swaps: two clusters become one, and a third becomes two, where that lowers F at once.
//!
//! # Definition
//!
//! A round:
//!
//! 1. Every cluster finds its cheapest merge, with cost F_ab − F_a − F_b. Every cluster whose splits
//!    [might gain](Clusters::may_gain) more than the cheapest merge of all finds its best [split](super::split), with
//!    gain F_c − F_1 − F_2. All are exact integers in the unit of the finest component.
//! 2. Merges, the cheapest first, meet splits, those that gain most first; ties go by number. A cluster takes part
//!    once. The round ends at the first merge that costs as much as the best split left gains.
//! 3. Each swap merges its pair, and the number that becomes free names the new part of the split cluster, in whatever
//!    component that is. Then the clusters [settle](mod@super::settle).
//!
//! Rounds go on until no swap pays, [`ROUNDS`] at most.
//!
//! # F falls, and the rounds end
//!
//! F is a sum over clusters, and no cluster takes part in two swaps, so the changes of a round add up exactly; each is
//! negative. Settling lowers F, too. F is an integer that is not negative.
//!
//! # Why
//!
//! The other phases move single faces, and end where only a merge and a split at once would pay. They also leave each
//! component the number of clusters that its area gave it, which is far from the best where faces are uneven. On even
//! meshes bounds rule out every split.

use super::candidates::Candidates;
use super::clusters::Clusters;
use super::settle::settle;
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;

/// Rounds at most. Ordinary meshes take under 20.
const ROUNDS: u32 = 32;

/// Makes rounds; `on_round` is called after each with swaps.
pub fn swap<E: Functional>(
    clusters: &mut Clusters<'_, E>,
    candidates: &mut Candidates,
    cancel: &Cancel,
    mut on_round: impl FnMut(&mut Clusters<'_, E>) -> Result<()>,
) -> Result<()> {
    for _ in 0..ROUNDS {
        if round(clusters, candidates, cancel)? == 0 {
            return Ok(());
        }
        on_round(clusters)?;
    }
    clusters.faces_left = 0;
    Ok(())
}

/// Makes one round. Returns the number of swaps.
fn round<E: Functional>(clusters: &mut Clusters<'_, E>, candidates: &mut Candidates, cancel: &Cancel) -> Result<usize> {
    cancel.check()?;
    candidates.refresh(clusters);
    let merges = candidates.merges();
    let Some(&(least, ..)) = merges.first() else { return Ok(0) };
    candidates.split(clusters, |cluster| clusters.may_gain(least, cluster));
    let splits = candidates.splits();

    let mut is_taken = vec![false; clusters.numbers()];
    let mut swaps = Vec::new();
    let mut first = 0;
    for (cost, a, b) in merges {
        if is_taken[a as usize] || is_taken[b as usize] {
            continue;
        }
        first += splits[first..].iter().take_while(|&&(_, cluster)| is_taken[cluster as usize]).count();
        if splits.get(first).is_none_or(|&(gain, _)| gain <= cost) {
            break;
        }
        let mut paying = splits[first..].iter().take_while(|&&(gain, _)| gain > cost).map(|&(_, cluster)| cluster);
        let is_apart = |&cluster: &u32| !is_taken[cluster as usize] && cluster != a && cluster != b;
        if let Some(split) = paying.find(is_apart) {
            [a, b, split].into_iter().for_each(|cluster| is_taken[cluster as usize] = true);
            swaps.push((a, b, split));
        }
    }

    let mut changed = Vec::with_capacity(3 * swaps.len());
    for &(a, b, split) in &swaps {
        changed.push(clusters.merge(a, b));
        let leaving = candidates.known_split(split).map_or(&[][..], |split| &split.leaving);
        changed.extend([split, clusters.split(split, leaving)]);
    }
    let made = swaps.len();
    settle(clusters, changed, u32::MAX, cancel)?;
    Ok(made)
}
