//! Clusters within a tolerance that dissolve: each of their faces becomes part of a cluster beside it.
//!
//! Where a few faces lie across an edge of a part, no shape of a cluster beside them is within the tolerance of all of
//! them, but each face is within that of one. Clusters are tried by their sizes, the smallest first. A cluster gives
//! away, round by round, the faces beside clusters whose shapes they are within the tolerance of, each to the one where
//! it costs least; if faces are left in the end, it stays as it was.
//!
//! # Work
//!
//! Clusters are tried until all faces and their neighbours have been looked at [`LOOKS_A_FACE`] times on average.

use super::moves::Clusters;
use crate::device::Cancel;
use crate::error::Result;

/// Looks at a face or a neighbour of one, on average.
const LOOKS_A_FACE: usize = 64;

/// No cluster.
const NONE: u32 = u32::MAX;

/// Clusters after some have dissolved.
#[derive(Debug)]
pub(super) struct Dissolved {
    /// One a face, numbered without gaps.
    pub labels: Vec<u32>,
    /// What the clusters that stay were.
    pub stay: Vec<u32>,
    /// Whether the bound on work ended it.
    pub is_bounded: bool,
}

/// Dissolves clusters.
pub(super) fn dissolved(clusters: &Clusters<'_>, cancel: &Cancel) -> Result<Dissolved> {
    let mut labels = clusters.labels.clone();
    let count = clusters.shapes.len() as u32;
    let mut members = super::faces::members(&labels, count as usize, |_| true);
    let mut by_size: Vec<u32> = (0..count).collect();
    by_size.sort_by_key(|&cluster| members[cluster as usize].len());
    let mut looks_left = LOOKS_A_FACE * clusters.faces.all_looks();
    for cluster in by_size {
        cancel.check()?;
        let all = std::mem::take(&mut members[cluster as usize]);
        let mut left = all.clone();
        while !left.is_empty() {
            let before = left.len();
            looks_left = looks_left.saturating_sub(clusters.faces.looks(&left));
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
    Ok(Dissolved { labels, stay, is_bounded: looks_left == 0 })
}
