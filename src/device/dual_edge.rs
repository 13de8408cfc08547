//! Dual edges between clusters and the order in which they collapse (P§5.4, P§6).
//!
//! The energy defines what a merge raises it by, in two forms, both integers: [`Functional::merge_cost`] for one merge
//! at a time, and [`Functional::packed_merge_cost`], 32 bits whose order is the order of the values, for the parallel
//! search of all clusters, on a gpu too.
//!
//! [`Functional::merge_cost`]: crate::energy::Functional::merge_cost
//! [`Functional::packed_merge_cost`]: crate::energy::Functional::packed_merge_cost
//!
//! # Ties
//!
//! Equal costs are the rule on regular meshes. The paper takes the neighbour with the largest number, which never
//! stalls but crawls: on a strip of equal faces, two pairs merge a round. A hash of the pair puts the edges of a
//! plateau in a random order instead, in which a constant share of them are the best at both ends.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Which of equally cheap dual edges is the best.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ties {
    /// The one with the smallest hash of the pair
    #[default]
    Hash,
    /// The one to the neighbour with the largest number
    LargestId,
}

/// The best dual edge of a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DualEdge {
    /// The cluster.
    pub cluster: u32,
    /// The neighbour it would best merge with.
    pub other: u32,
    /// The packed merge cost ([`crate::energy::Functional::packed_merge_cost`]).
    pub cost: u32,
}

/// A 32-bit hash of an unordered pair.
pub fn hash_pair(a: u32, b: u32) -> u32 {
    let mix = |mut x: u32| {
        x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
        x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
        x ^ x >> 16
    };
    mix(mix(a.min(b)).wrapping_add(0x9e37_79b9) ^ a.max(b))
}

/// The rank of a dual edge among those of a cluster: smaller is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rank<Cost> {
    /// The merge cost.
    pub cost: Cost,
    tie: u32,
    low: u32,
    high: u32,
}

impl<Cost> Rank<Cost> {
    /// The rank of the edge to `other`, seen from `cluster`.
    pub fn new(cost: Cost, cluster: u32, other: u32, ties: Ties) -> Self {
        let tie = match ties {
            Ties::Hash => hash_pair(cluster, other),
            Ties::LargestId => !other,
        };
        Self { cost, tie, low: cluster.min(other), high: cluster.max(other) }
    }

    /// The two clusters, the smaller number first.
    pub fn ends(&self) -> (u32, u32) {
        (self.low, self.high)
    }
}

/// The mutual pairs of best dual edges. `edges` are in the order of their clusters.
///
/// `chosen` is memory for a number a cluster, which a caller with many rounds keeps: only those of the clusters that
/// have edges are written and read.
pub fn mutual(edges: &[DualEdge], chosen: &mut Vec<u32>) -> Vec<Rank<u32>> {
    let clusters = edges.last().map_or(0, |edge| edge.cluster as usize + 1);
    chosen.resize(clusters.max(chosen.len()), u32::MAX);
    for edge in edges {
        chosen[edge.cluster as usize] = edge.other;
    }
    edges
        .iter()
        .filter(|edge| edge.cluster < edge.other && chosen[edge.other as usize] == edge.cluster)
        .map(|edge| Rank::new(edge.cost, edge.cluster, edge.other, Ties::Hash))
        .collect()
}

/// Keeps the pairs that cost no more than their median, in any order.
pub fn keep_cheaper_half(mutual: &mut Vec<Rank<u32>>) {
    if !mutual.is_empty() {
        let middle = (mutual.len() - 1) / 2;
        let (_, median, _) = mutual.select_nth_unstable(middle);
        let most = median.cost;
        mutual.retain(|pair| pair.cost <= most);
    }
}

/// Sorts, and leaves out those after the first `most`.
pub fn keep_first<T: Ord + Send>(ranked: &mut Vec<T>, most: usize) {
    if most < ranked.len() {
        ranked.select_nth_unstable(most);
        ranked.truncate(most);
    }
    ranked.par_sort_unstable();
}

/// Two clusters that merge, the smaller number first, in the order in which the first becomes part of the second: the
/// one with more faces keeps its number, the smaller number of equal ones.
pub fn from_into((low, high): (u32, u32), [of_low, of_high]: [u32; 2]) -> (u32, u32) {
    if of_high > of_low { (low, high) } else { (high, low) }
}
