//! The search for best dual edges along the boundaries of all clusters.

use super::{packed_cost, rough_end};
use crate::device::FREE;
use crate::device::cpu::Partition;
use crate::device::cpu::boundary_faces::ClusterList;
use crate::device::cpu::labels::Labels;
use crate::device::dual_edge::{Rank, Ties};
use crate::energy::{Functional, Sums};
use crate::parallel::push_if;
use crate::surface::DualGraph;

/// The choices of the clusters. `living` are those that may have faces, ascending; ones that have none are dropped.
pub fn choices<E: Functional>(partition: &mut Partition<'_, E>, living: &mut Vec<u32>, ties: Ties) -> Vec<(u32, u32)> {
    let Partition { graph, labels, clusters, boundary } = partition;
    living.retain(|&cluster| clusters.sums(cluster).faces() > 0);
    let choices = boundary.search(living, Vec::new, |others, list| {
        let cluster = list.cluster;
        let own = rough_end(clusters, cluster);
        let rank = |other: u32| Rank::new(packed_cost(clusters, cluster, other), cluster, other, ties);
        let (mut best, mut cost) = (FREE, f32::INFINITY);
        find_neighbours(graph, labels, list, others);
        for &other in others.iter() {
            let rough = E::rough_merge_cost(own, rough_end(clusters, other));
            // packed costs decide between edges whose rough costs are too close
            if rough <= cost * E::ROUGH_MARGIN
                && other != best
                && (rough * E::ROUGH_MARGIN < cost || rank(other) < rank(best))
            {
                (best, cost) = (other, rough);
            }
        }
        (best != FREE).then_some((cluster, best))
    });
    choices.into_iter().flatten().collect()
}

/// Slots of the table of neighbours that were found last.
const RECENT: usize = 16;

/// Finds the clusters beside those of a list, some maybe several times, in place of what `others` has. Faces that are
/// on no boundary are dropped from the list.
pub fn find_neighbours<E: Functional>(
    graph: &DualGraph<E>,
    labels: &Labels,
    list: ClusterList<'_>,
    others: &mut Vec<u32>,
) {
    let cluster = list.cluster;
    others.clear();
    list.retain(|face| {
        let before = others.len();
        for &near in graph.neighbours_of(face) {
            let other = labels.near_boundary(near);
            push_if(others, other, other != cluster);
        }
        others.len() > before
    });
    // most repetitions follow soon after the first
    let mut recent = [cluster; RECENT];
    others.retain(|&other| std::mem::replace(&mut recent[other as usize % RECENT], other) != other);
}
