//! Whether any swap might pay, from totals alone: what even meshes get instead of lists of faces and splits.
//!
//! No swap pays where the largest bound of a split's gain is no more than the cheapest merge
//! ([`Functional::most_gain`](crate::energy::Functional::most_gain)). The labels are those of a
//! [round](super::swap) that makes nothing; on scans it takes a quarter of the round's time, and a round is a tenth of
//! a `fast` clustering.

use rayon::prelude::*;

use super::totals::Totals;
use crate::surface::DualGraph;

/// Faces of a chunk.
const CHUNK: usize = 1 << 13;

/// Whether a swap might pay. Every cluster has faces.
pub fn may_pay(graph: &DualGraph, labels: &[u32], clusters: usize) -> bool {
    let totals = Totals::of_clusters(graph, labels, clusters);
    let Some(least) = cheapest_merge(graph, labels, &totals) else { return false };
    let mut faces_of_large: Vec<Option<Vec<u32>>> =
        totals.iter().map(|totals| (totals.energy() > least).then(Vec::new)).collect();
    for (face, &label) in (0..).zip(labels) {
        if let Some(faces) = &mut faces_of_large[label as usize] {
            faces.push(face);
        }
    }
    let may_gain = |(totals, faces): (&Totals, &Option<Vec<u32>>)| {
        faces.as_ref().is_some_and(|faces| totals.may_gain(least, graph, faces))
    };
    totals.par_iter().zip(&faces_of_large).any(may_gain)
}

/// What the cheapest merge of two neighbouring clusters costs.
fn cheapest_merge(graph: &DualGraph, labels: &[u32], totals: &[Totals]) -> Option<i128> {
    let cheapest_of = |face: u32| {
        let own = labels[face as usize];
        let others = graph.neighbours_of(face).iter().map(|&near| labels[near as usize]);
        others.filter(|&other| other < own).map(|other| totals[own as usize].merge_cost(&totals[other as usize])).min()
    };
    (0..labels.len() as u32).into_par_iter().with_min_len(CHUNK).filter_map(cheapest_of).min()
}
