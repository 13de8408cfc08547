//! Numbers of clusters that were relocated: a cluster keeps the number of the one whose faces it has.
//!
//! A hierarchy follows clusters by their numbers, from level to level. So of all pairs of a cluster before and one
//! after, those with the most faces in common get one number, the pair with the most first (ties: the smaller numbers).
//! Clusters that no pair is left for, such as the second part of a split, take the numbers that are left, both
//! ascending.

use std::cmp::Reverse;

/// The numbers 0, 1, … in place of those of some clusters, in their order.
pub fn compact(labels: &[u32]) -> Vec<u32> {
    let mut number = vec![0; labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0)];
    labels.iter().for_each(|&label| number[label as usize] = 1);
    let mut next = 0;
    for number in &mut number {
        next += std::mem::replace(number, next);
    }
    labels.iter().map(|&label| number[label as usize]).collect()
}

/// `after`, with the numbers of `before`; both have as many clusters.
pub fn kept(before: &[u32], after: &[u32]) -> Vec<u32> {
    let mut pairs: Vec<(u32, u32)> = before.iter().copied().zip(after.iter().copied()).collect();
    pairs.sort_unstable();
    let mut common: Vec<(Reverse<usize>, u32, u32)> =
        pairs.chunk_by(|a, b| a == b).map(|equal| (Reverse(equal.len()), equal[0].0, equal[0].1)).collect();
    let mut left: Vec<u32> = common.iter().map(|&(_, old, _)| old).collect();
    left.dedup();
    common.sort_unstable();
    let numbers = |labels: &[u32]| labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0);
    let mut is_taken = vec![false; numbers(before)];
    let mut number_of_cluster = vec![None; numbers(after)];
    for (_, old, new) in common {
        let number = &mut number_of_cluster[new as usize];
        if number.is_none() && !is_taken[old as usize] {
            *number = Some(old);
            is_taken[old as usize] = true;
        }
    }
    left.retain(|&old| !is_taken[old as usize]);
    let mut left = left.into_iter();
    let number_of_cluster: Vec<u32> =
        number_of_cluster.into_iter().map(|number| number.or_else(|| left.next()).unwrap_or_default()).collect();
    after.iter().map(|&new| number_of_cluster[new as usize]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clusters_keep_the_number_of_those_whose_faces_they_have() {
        // 7 and 9 merge, 4 is split
        let before = [7, 7, 9, 4, 4, 4, 4, 2];
        assert_eq!(kept(&before, &[0, 0, 0, 3, 1, 1, 1, 2]), [7, 7, 7, 9, 4, 4, 4, 2]);
        assert_eq!(kept(&before, &before.map(|label| label - 2)), before);
        assert_eq!(kept(&[5, 3], &[0, 1]), [5, 3]);
        // of two clusters that lie in one, the first takes its number
        assert_eq!(kept(&[0, 0, 1, 1], &[0, 1, 1, 1]), [0, 1, 1, 1]);
        assert_eq!(compact(&[8, 8, 6, 1, 6]), [2, 2, 1, 0, 1]);
    }
}
