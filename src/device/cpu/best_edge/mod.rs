//! Best dual edges (P§5.4): which neighbour each cluster would merge with at the lowest cost.
//!
//! Two searches find the *choices*: each cluster that has faces and neighbours, with the neighbour that it would best
//! merge with, in the order of the clusters. [`contraction`] keeps a graph of the clusters while each is still what
//! merges made of single faces; a round then costs in proportion to the clusters that merge and their neighbours.
//! [`boundary`] searches along the boundary faces, whatever faces have moved. [`queue`] has the cheapest edge of all,
//! for one merge at a time.

pub mod boundary;
pub mod contraction;
pub mod queue;

use super::clusters::Clusters;
use super::tuning::chunks::ITEMS;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{DualEdge, FREE};
use crate::energy::{End, Functional, Sums};
use crate::parallel;

/// The best dual edges, given the choices.
pub fn optimal<E: Functional>(clusters: &Clusters<E>, choices: &[(u32, u32)]) -> Vec<DualEdge> {
    parallel::map(choices.len(), ITEMS, |nth| {
        let (cluster, other) = choices[nth];
        DualEdge { cluster, other, cost: packed_cost(clusters, cluster, other) }
    })
}

/// The pairs of clusters that chose each other. Costs less than [`optimal`]: only these edges get packed costs.
pub fn mutual<E: Functional>(clusters: &Clusters<E>, choices: &[(u32, u32)]) -> Vec<Rank<u32>> {
    let mut choice_of_cluster = vec![FREE; clusters.len()];
    choices.iter().for_each(|&(cluster, other)| choice_of_cluster[cluster as usize] = other);
    let is_mutual = |&&(cluster, other): &&(u32, u32)| cluster < other && choice_of_cluster[other as usize] == cluster;
    let rank = |&(low, high): &(u32, u32)| Rank::new(packed_cost(clusters, low, high), low, high, Ties::Hash);
    parallel::list(choices.len(), ITEMS, &|range, pairs| {
        pairs.extend(choices[range].iter().filter(is_mutual).map(rank))
    })
}

/// The packed cost of merging two clusters.
fn packed_cost<E: Functional>(clusters: &Clusters<E>, cluster: u32, other: u32) -> u32 {
    E::packed_merge_cost(end(clusters, cluster), end(clusters, other), clusters.energy_shift(cluster))
}

/// A cluster as an end of a dual edge.
fn end<E: Functional>(clusters: &Clusters<E>, cluster: u32) -> End<E::Point> {
    clusters.sums(cluster).end(clusters.cached(cluster).proxy)
}

/// The same in single precision.
fn rough_end<E: Functional>(clusters: &Clusters<E>, cluster: u32) -> End<E::Point, f32> {
    End { weight: clusters.sums(cluster).weight() as f32, proxy: clusters.cached(cluster).proxy }
}
