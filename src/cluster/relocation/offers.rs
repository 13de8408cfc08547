//! The merge and the split that each cluster offers, kept until the cluster changes.

use std::cmp::Reverse;

use super::split::Split;
use crate::cluster::connected::Clusters;
use crate::energy::Functional;
use crate::parallel;
use crate::surface::DualGraph;

/// Clusters whose merges a thread finds at least.
const MERGES_A_THREAD: usize = 64;

/// Clusters whose splits a thread finds at least.
const SPLITS_A_THREAD: usize = 8;

/// Clusters, and what each of them offers, by its number.
#[derive(Debug, Clone)]
pub struct Offers<'a, E: Functional> {
    /// The clusters.
    pub clusters: Clusters<'a, E>,
    /// The cost of its cheapest merge, and the other cluster, the smallest number of equally cheap ones.
    merges: Vec<Option<(i128, u32)>>,
    /// Its split, none where it has one face; None where that is not known.
    splits: Vec<Option<Option<Split>>>,
}

impl<'a, E: Functional> Offers<'a, E> {
    /// Of labels in which every face has one.
    pub fn new(graph: &'a DualGraph<E>, labels: Vec<u32>) -> Self {
        Self { clusters: Clusters::new(graph, labels), merges: Vec::new(), splits: Vec::new() }
    }

    /// All cheapest merges, each pair once: cost and both clusters; the cheapest first, ties by number.
    pub fn merges(&mut self) -> Vec<(i128, u32, u32)> {
        self.refresh();
        let merges = (0..).zip(&self.merges).filter_map(|(cluster, merge)| {
            let (cost, other) = (*merge)?;
            (cluster < other || !self.is_cheapest(other, cluster)).then_some((cost, cluster, other))
        });
        let mut merges: Vec<_> = merges.collect();
        merges.sort_unstable();
        merges
    }

    /// Whether the cheapest merge of a cluster is the one with this other one.
    pub fn is_cheapest(&self, cluster: u32, with: u32) -> bool {
        self.merges[cluster as usize].is_some_and(|(_, other)| other == with)
    }

    /// All splits that are known, after those of the wanted clusters were found: gain and cluster; those that gain most
    /// first, ties by number.
    pub fn splits(&mut self, wanted: impl Fn(&Clusters<'_, E>, u32) -> bool + Sync) -> Vec<(i128, u32)> {
        self.refresh();
        let Self { clusters, splits, .. } = self;
        let (clusters, numbers) = (&*clusters, clusters.numbers());
        parallel::runs_mut(splits, SPLITS_A_THREAD, &|first, splits| {
            for (cluster, split) in (first as u32..).zip(splits) {
                if split.is_none() && wanted(clusters, cluster) {
                    let mut faces = clusters.faces(cluster).to_vec();
                    faces.sort_unstable();
                    *split = Some(Split::of(clusters.graph, &faces, clusters.totals(cluster).shift));
                }
            }
        });
        let known = splits.iter().zip(numbers);
        let mut by_gain: Vec<(i128, u32)> =
            known.filter_map(|(split, cluster)| Some((split.as_ref()?.as_ref()?.gain, cluster))).collect();
        by_gain.sort_unstable_by_key(|&(gain, cluster)| (Reverse(gain), cluster));
        by_gain
    }

    /// The faces that leave a cluster with its split, if that is known.
    pub fn leaving(&self, cluster: u32) -> &[u32] {
        self.splits[cluster as usize].iter().flatten().next().map_or(&[], |split| &split.leaving)
    }

    /// Makes the split that is known. Returns the number of the second part.
    pub fn split(&mut self, cluster: u32) -> u32 {
        let leaving = self.leaving(cluster).to_vec();
        self.clusters.split(&leaving)
    }

    /// Forgets the splits of clusters that changed. Finds the merges of these and of those beside them anew.
    fn refresh(&mut self) {
        let has_changed = self.clusters.take_changes();
        self.merges.resize(has_changed.len(), None);
        self.splits.resize(has_changed.len(), None);
        let Self { clusters, merges, splits } = self;
        let clusters = &*clusters;
        let changed = clusters.numbers().filter(|&cluster| has_changed[cluster as usize]);
        changed.clone().for_each(|cluster| splits[cluster as usize] = None);
        let mut is_stale = has_changed.clone();
        // where all have changed, all are stale
        if has_changed.contains(&false) {
            for &face in changed.flat_map(|cluster| clusters.faces(cluster)) {
                for &near in clusters.graph.neighbours_of(face) {
                    is_stale[clusters.label(near) as usize] = true;
                }
            }
        }
        parallel::runs_mut(merges, MERGES_A_THREAD, &|first, merges| {
            for (cluster, merge) in (first as u32..).zip(merges) {
                // the other one may no longer lie beside it
                if is_stale[cluster as usize] || merge.is_some_and(|(_, other)| has_changed[other as usize]) {
                    let cost = |other| (clusters.totals(cluster).merge_cost(clusters.totals(other)), other);
                    *merge = clusters.beside(cluster).into_iter().map(cost).min();
                }
            }
        });
    }
}
