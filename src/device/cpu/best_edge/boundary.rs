//! The search for best dual edges along the boundaries of all clusters.

use super::packed_cost;
use crate::device::cpu::Partition;
use crate::device::cpu::boundary_faces::ClusterList;
use crate::device::cpu::labels::Labels;
use crate::device::dual_edge::{Rank, Ties};
use crate::surface::DualGraph;

/// The choices of the clusters. `living` are those that may have faces, ascending; ones that have none are dropped.
pub fn choices(partition: &mut Partition<'_>, living: &mut Vec<u32>, ties: Ties) -> Vec<(u32, u32)> {
    let Partition { graph, labels, clusters, boundary } = partition;
    living.retain(|&cluster| clusters.sums(cluster).faces > 0);
    let choices = boundary.search(living, Vec::new, |others, list| {
        let cluster = list.cluster;
        find_neighbours(graph, labels, list, others);
        let rank = |&other: &u32| Rank::new(packed_cost(clusters, cluster, other), cluster, other, ties);
        others.iter().copied().min_by_key(rank).map(|best| (cluster, best))
    });
    choices.into_iter().flatten().collect()
}

/// Finds the clusters beside that of a list, ascending, in place of what `others` has. Drops faces from the list that
/// are on no boundary.
pub fn find_neighbours(graph: &DualGraph, labels: &Labels, list: ClusterList<'_>, others: &mut Vec<u32>) {
    let cluster = list.cluster;
    others.clear();
    list.retain(|face| {
        let before = others.len();
        let near = graph.neighbours_of(face).iter().map(|&near| labels.near_boundary(near));
        others.extend(near.filter(|&other| other != cluster));
        others.len() > before
    });
    others.sort_unstable();
    others.dedup();
}
