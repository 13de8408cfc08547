//! Best dual edges (P§5.4): which neighbour each cluster would merge with at the lowest cost.
//!
//! One interface, [`BestEdge`], over two implementations. [`contraction`] keeps a graph of the clusters while each is
//! still what merges made of single faces; a round then costs in proportion to the clusters that merge and their
//! neighbours. [`boundary`] searches along the boundary faces, whatever faces have moved. [`queue`] has the cheapest
//! edge of all, for one merge at a time.

pub mod boundary;
pub mod contraction;
pub mod queue;

use super::clusters::Clusters;
use crate::device::DualEdge;
use crate::device::dual_edge::Rank;
use crate::energy::{End, Energy, Functional, Sums};

/// Finds the best dual edges of the current clusters.
pub trait BestEdge {
    /// The best dual edge of each cluster that has faces and neighbours, in the order of the clusters.
    fn optimal(&mut self) -> Vec<DualEdge>;

    /// The pairs of clusters whose best dual edges lead to each other, in any order. Costs less than
    /// [`optimal`](Self::optimal): only these edges need packed costs.
    fn mutual(&mut self) -> Vec<Rank<u32>>;
}

/// The packed cost of merging two clusters.
fn packed_cost_of(clusters: &Clusters, cluster: u32, other: u32) -> u32 {
    Energy::packed_merge_cost(end(clusters, cluster), end(clusters, other), clusters.energy_shift(cluster))
}

/// A cluster as an end of a dual edge.
fn end(clusters: &Clusters, cluster: u32) -> End {
    clusters.sums(cluster).end(clusters.proxy(cluster))
}
