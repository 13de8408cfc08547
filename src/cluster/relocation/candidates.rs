//! The merge and the split that each cluster offers, kept until the cluster changes.

use rayon::prelude::*;

use super::clusters::{CHUNK, Clusters};
use super::split::Split;
use crate::energy::Functional;

/// The cheapest merge of a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Merge {
    /// What it raises F by, in the unit of the finest component.
    pub cost: i128,
    /// The neighbour to merge with; the smaller number of equally cheap ones.
    pub other: u32,
}

/// What the clusters offer; entries of numbers that are free mean nothing.
#[derive(Debug, Clone, Default)]
pub struct Candidates {
    merges: Vec<Option<Merge>>,
    splits: Vec<KnownSplit>,
}

/// A split, if it was computed since the cluster changed.
#[derive(Debug, Clone, Default)]
enum KnownSplit {
    #[default]
    Unknown,
    Known(Option<Split>),
}

impl Candidates {
    /// Follows the changes since the last call: merges are computed anew, splits forgotten.
    pub fn refresh<E: Functional>(&mut self, clusters: &mut Clusters<'_, E>) {
        let touched = clusters.take_touched();
        let numbers = clusters.numbers();
        self.merges.resize(numbers, None);
        self.splits.resize(numbers, KnownSplit::Unknown);
        let mut is_touched = vec![false; numbers];
        touched.iter().for_each(|&cluster| is_touched[cluster as usize] = true);
        let mut is_stale = is_touched.clone();
        touched.iter().for_each(|&cluster| self.splits[cluster as usize] = KnownSplit::Unknown);
        // where all are touched, all are stale
        for &cluster in touched.iter().filter(|_| touched.len() < numbers) {
            for &face in clusters.faces(cluster) {
                for &near in clusters.graph.neighbours_of(face) {
                    is_stale[clusters.label(near) as usize] = true;
                }
            }
        }
        // one that no longer lies beside the other end of its merge
        for (cluster, merge) in self.merges.iter().enumerate() {
            is_stale[cluster] |= merge.is_some_and(|merge| is_touched[merge.other as usize]);
        }
        let clusters = &*clusters;
        let merge = |cluster: u32| {
            let merge = |other: u32| Merge { cost: clusters.merge_cost(cluster, other), other };
            clusters.beside(cluster).into_iter().map(merge).min_by_key(|merge| (merge.cost, merge.other))
        };
        self.merges
            .par_iter_mut()
            .enumerate()
            .with_min_len(CHUNK)
            .filter(|&(cluster, _)| is_stale[cluster])
            .for_each(|(cluster, known)| *known = merge(cluster as u32));
    }

    /// Computes the splits of the wanted clusters, as far as they are not known.
    pub fn split<E: Functional>(&mut self, clusters: &Clusters<'_, E>, wanted: impl Fn(u32) -> bool + Sync) {
        let unknown = |&(cluster, ref split): &(usize, &mut KnownSplit)| {
            matches!(split, KnownSplit::Unknown) && wanted(cluster as u32)
        };
        self.splits.par_iter_mut().enumerate().with_min_len(8).filter(unknown).for_each(|(cluster, split)| {
            let mut faces = clusters.faces(cluster as u32).to_vec();
            faces.sort_unstable();
            *split = KnownSplit::Known(Split::of(clusters.graph, &faces, clusters.shift(cluster as u32)));
        });
    }

    /// The cheapest merge of a cluster; none without neighbours.
    pub fn merge(&self, cluster: u32) -> Option<Merge> {
        self.merges[cluster as usize]
    }

    /// The split of a cluster, if it was computed and there is one.
    pub fn known_split(&self, cluster: u32) -> Option<&Split> {
        match &self.splits[cluster as usize] {
            KnownSplit::Known(split) => split.as_ref(),
            KnownSplit::Unknown => None,
        }
    }

    /// All merges, each pair once: cost and both clusters; the cheapest first, ties by number.
    pub fn merges(&self) -> Vec<(i128, u32, u32)> {
        let mut merges: Vec<(i128, u32, u32)> = (0..)
            .zip(&self.merges)
            .filter_map(|(cluster, merge)| {
                let Merge { cost, other } = (*merge)?;
                let is_mutual = self.merge(other).is_some_and(|back| back.other == cluster);
                (cluster < other || !is_mutual).then_some((cost, cluster, other))
            })
            .collect();
        merges.sort_unstable();
        merges
    }

    /// All known splits: gain and cluster; those that gain most first, ties by number.
    pub fn splits(&self) -> Vec<(i128, u32)> {
        let mut splits: Vec<(i128, u32)> = (0..self.splits.len() as u32)
            .filter_map(|cluster| self.known_split(cluster).map(|split| (split.gain, cluster)))
            .collect();
        splits.sort_unstable_by_key(|&(gain, cluster)| (std::cmp::Reverse(gain), cluster));
        splits
    }
}
