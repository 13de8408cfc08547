//! The search for best dual edges along the boundaries of all clusters.

use super::{BestEdge, end, packed_cost_of};
use crate::device::cpu::boundary_faces::{BoundaryFaces, ClusterList};
use crate::device::cpu::clusters::Clusters;
use crate::device::cpu::labels::Labels;
use crate::device::cpu::tuning::filter::Filter;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{DualEdge, FREE};
use crate::energy::{Energy, Functional};
use crate::surface::DualGraph;

/// Costs in f64 that differ by this factor or more are in the order of the packed costs, which resolve 1 + 2⁻²⁴.
const MARGIN: f64 = 1.0 + 1e-6;

/// The search, on what the steps own.
pub struct BoundarySearch<'a> {
    pub graph: &'a DualGraph,
    pub labels: &'a Labels,
    pub clusters: &'a Clusters,
    pub boundary: &'a mut BoundaryFaces,
    /// Clusters that may have faces, ascending. The search drops those that have none.
    pub living: &'a mut Vec<u32>,
    pub ties: Ties,
}

impl BoundarySearch<'_> {
    /// The neighbour that each living cluster would best merge with; [`FREE`] for one without neighbours.
    fn choices(&mut self) -> Vec<u32> {
        let Self { graph, labels, clusters, boundary, living, ties } = self;
        let (graph, labels, clusters, ties) = (*graph, *labels, *clusters, *ties);
        living.retain(|&cluster| clusters.sums(cluster).faces > 0);
        boundary.search(living, Filter::default, |others, list| {
            let cluster = list.cluster;
            let own = end(clusters, cluster);
            let rank = |other: u32| Rank::new(packed_cost_of(clusters, cluster, other), cluster, other, ties);
            let (mut best, mut cost) = (FREE, f64::INFINITY);
            find_neighbours(graph, labels, list, others);
            for &other in others.kept() {
                let about = Energy::merge_cost_about(own, end(clusters, other));
                // packed costs decide between edges whose costs in f64 are too close
                if about <= cost * MARGIN && other != best && (about * MARGIN < cost || rank(other) < rank(best)) {
                    (best, cost) = (other, about);
                }
            }
            best
        })
    }
}

impl BestEdge for BoundarySearch<'_> {
    fn optimal(&mut self) -> Vec<DualEdge> {
        let choices = self.choices();
        let edge = |(&cluster, &other): (&u32, &u32)| {
            (other != FREE).then(|| DualEdge { cluster, other, cost: packed_cost_of(self.clusters, cluster, other) })
        };
        self.living.iter().zip(&choices).filter_map(edge).collect()
    }

    fn mutual(&mut self) -> Vec<Rank<u32>> {
        let choices = self.choices();
        let mut choice_of_cluster = vec![FREE; self.clusters.len()];
        for (&cluster, &other) in self.living.iter().zip(&choices) {
            choice_of_cluster[cluster as usize] = other;
        }
        let is_mutual = |&(&cluster, &other): &(&u32, &u32)| {
            other != FREE && cluster < other && choice_of_cluster[other as usize] == cluster
        };
        let pair =
            |(&low, &high): (&u32, &u32)| Rank::new(packed_cost_of(self.clusters, low, high), low, high, Ties::Hash);
        self.living.iter().zip(&choices).filter(is_mutual).map(pair).collect()
    }
}

/// Slots of the table of neighbours that were found last.
const RECENT: usize = 16;

/// Finds the clusters beside those of a list, some maybe several times, in place of what `others` has. Faces that are
/// on no boundary are dropped from the list.
pub fn find_neighbours(graph: &DualGraph, labels: &Labels, list: ClusterList<'_>, others: &mut Filter) {
    let cluster = list.cluster;
    others.clear();
    list.retain(|face| {
        let near = graph.neighbours_of(face);
        let before = others.kept().len();
        others.add(near.len(), near.iter().map(|&near| labels.near_boundary(near)), |other| other != cluster);
        others.kept().len() > before
    });
    // most repetitions follow soon after the first
    let mut recent = [cluster; RECENT];
    others.retain(|other| std::mem::replace(&mut recent[other as usize % RECENT], other) != other);
}
