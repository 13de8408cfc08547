//! Clusters within a tolerance that dissolve: each of their faces becomes part of a cluster beside it.
//!
//! Where a few faces lie across an edge of a part, no shape of a cluster beside them is within the tolerance of all of
//! them, but each face is within that of one. Clusters are tried by their sizes, the smallest first. A cluster gives
//! away, round by round, the faces beside clusters whose shapes they are within the tolerance of, each to the one where
//! it costs least; if faces are left in the end, it stays as it was.
//!
//! # Work
//!
//! Clusters are tried until all faces have been looked at [`LOOKS`] times on average.

use super::moves::Clusters;

/// Looks at a face, on average.
const LOOKS: usize = 64;

/// No cluster.
const NONE: u32 = u32::MAX;

/// The labels without the clusters that dissolve, numbered without gaps, and the clusters that stay.
pub(super) fn dissolved(clusters: &Clusters<'_>) -> (Vec<u32>, Vec<u32>) {
    let mut labels = clusters.labels.clone();
    let count = clusters.shapes.len() as u32;
    let mut members = super::faces::members(&labels, count as usize, |_| true);
    let mut by_size: Vec<u32> = (0..count).collect();
    by_size.sort_by_key(|&cluster| members[cluster as usize].len());
    let mut looks_left = LOOKS * labels.len();
    for cluster in by_size {
        let all = std::mem::take(&mut members[cluster as usize]);
        let mut left = all.clone();
        while !left.is_empty() {
            let before = left.len();
            looks_left = looks_left.saturating_sub(before);
            left.retain(|&face| match clusters.best_beside(face, &labels).filter(|_| looks_left > 0) {
                Some((_, to)) => {
                    labels[face as usize] = to;
                    false
                }
                None => true,
            });
            if left.len() == before {
                break;
            }
        }
        if left.is_empty() {
            all.iter().for_each(|&face| members[labels[face as usize] as usize].push(face));
        } else {
            all.iter().for_each(|&face| labels[face as usize] = cluster);
            members[cluster as usize] = all;
        }
    }
    let stay: Vec<u32> = (0..count).filter(|&cluster| !members[cluster as usize].is_empty()).collect();
    let mut number_of = vec![NONE; count as usize];
    (0..).zip(&stay).for_each(|(number, &cluster)| number_of[cluster as usize] = number);
    labels.iter_mut().for_each(|label| *label = number_of[*label as usize]);
    (labels, stay)
}
