//! Decides from [`Bounds`] whether a [round](super::swap) of swaps could change anything.
//!
//! None could where no split gains more than the cheapest merge costs. One pass over the faces shows that on even
//! meshes, where a round would first make lists of faces, merges and splits: 8 % of the instructions of a clustering of
//! igea in 5,000 clusters at quality `fast` (`benches/results/2026-11-23-two-cores/swaps.md`).

use rayon::prelude::*;

use crate::energy::{Bounds, Functional};
use crate::surface::DualGraph;

/// Faces of a chunk.
const CHUNK: usize = 1 << 13;

/// Whether a swap might pay. Every cluster has faces, and every face a cluster.
pub fn may_pay<E: Functional>(graph: &DualGraph<E>, labels: &[u32], clusters: usize) -> bool {
    debug_assert!(clusters <= labels.len());
    let mut all = vec![(E::SplitBounds::default(), 1.0); clusters];
    for component in &graph.components {
        let unit = f64::from(1 << component.energy_shift);
        for face in component.range() {
            let (bounds, of_cluster) = &mut all[labels[face] as usize];
            bounds.add(graph.face(face));
            *of_cluster = unit;
        }
    }
    let most = all.iter().map(|(bounds, unit)| bounds.most_gain() * unit).fold(f64::NEG_INFINITY, f64::max);
    let is_cheap = |a: u32, b: u32| {
        let ((a, unit), (b, _)) = (&all[a as usize], &all[b as usize]);
        a.least_merge_cost(b) * unit < most
    };
    labels.par_chunks(CHUNK).enumerate().any(|(chunk, own)| {
        (chunk as u32 * CHUNK as u32..).zip(own).any(|(face, &own)| {
            let others = graph.neighbours_of(face).iter().map(|&near| labels[near as usize]);
            others.filter(|&other| other < own).any(|other| is_cheap(own, other))
        })
    })
}
