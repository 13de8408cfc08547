//! One clustering of two: each component from that in which it is cheaper.
//!
//! Two clusterings with the same number of clusters may share them among the components in different ways. A cluster is
//! worth λ, the cost of the cheapest merge in the clustering with the lower F. Each component is taken from the one in
//! which F of its clusters + λ · their number is smaller, the first where both are equal. The number of clusters that
//! results is not the one that was wanted; [`mod@super::resize`] makes it so.

use crate::cluster::connected::Clusters;
use crate::energy::Functional;

/// The labels of the mix. The first clustering is the one with the lower F, and `cluster_worth` is λ. None where all
/// components are taken from the first.
pub fn mixed<E: Functional>(
    first: &Clusters<'_, E>,
    second: &Clusters<'_, E>,
    cluster_worth: i128,
) -> Option<Vec<u32>> {
    let [of_first, of_second] = [first, second].map(|clusters| costs(clusters, cluster_worth));
    let mut labels = first.labels().to_vec();
    let all = first.graph.components.iter().zip(of_first.iter().zip(&of_second));
    for (component, _) in all.filter(|(_, (of_first, of_second))| of_second < of_first) {
        component.range().for_each(|face| labels[face] = second.label(face as u32) + first.numbers().end);
    }
    (labels != first.labels()).then_some(labels)
}

/// F + λ · clusters of each component, less what no labels change.
fn costs<E: Functional>(clusters: &Clusters<'_, E>, cluster_worth: i128) -> Vec<i128> {
    let component_of_face = clusters.graph.component_of_face();
    let mut costs = vec![0; clusters.graph.components.len()];
    for cluster in clusters.numbers() {
        if let Some(&face) = clusters.faces(cluster).first() {
            costs[component_of_face[face as usize] as usize] += cluster_worth - clusters.totals(cluster).explained();
        }
    }
    costs
}
