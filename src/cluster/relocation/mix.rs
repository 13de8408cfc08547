//! One clustering of two: each component from that in which it is cheaper.
//!
//! Two clusterings with the same number of clusters may share them among the components in different ways. A cluster is
//! worth λ, the cost of the cheapest merge in the clustering with the lower F. Each component is taken from the one in
//! which F of its clusters + λ · their number is smaller, the first where both are equal. The number of clusters that
//! results is not the one that was wanted; [`mod@super::resize`] makes it so.

use super::clusters::Clusters;
use crate::energy::Functional;

/// The labels of the mix. The first clustering is the one with the lower F, and `cluster_worth` is λ. None where all
/// components are taken from the first.
pub fn mixed<E: Functional>(
    first: &Clusters<'_, E>,
    second: &Clusters<'_, E>,
    cluster_worth: i128,
) -> Option<Vec<u32>> {
    let of_first = costs(first, cluster_worth);
    let of_second = costs(second, cluster_worth);
    let mut labels = first.labels().to_vec();
    let mut are_mixed = false;
    for (component, (first_cost, second_cost)) in first.graph.components.iter().zip(of_first.iter().zip(&of_second)) {
        if second_cost < first_cost {
            are_mixed = true;
            for face in component.range() {
                labels[face] = second.label(face as u32) + first.numbers() as u32;
            }
        }
    }
    are_mixed.then_some(labels)
}

/// F + λ · clusters of each component, less what no labels change.
fn costs<E: Functional>(clusters: &Clusters<'_, E>, cluster_worth: i128) -> Vec<i128> {
    let mut costs = vec![0; clusters.graph.components.len()];
    let starts: Vec<u32> = clusters.graph.components.iter().map(|component| component.first_face).collect();
    for cluster in 0..clusters.numbers() as u32 {
        if let Some(face) = clusters.faces(cluster).first() {
            let component = starts.partition_point(|start| start <= face) - 1;
            costs[component] += cluster_worth - clusters.explained(cluster);
        }
    }
    costs
}
