//! A start by merging from single faces, over all components at once.
//!
//! Every face is a cluster. In each round every cluster finds its best dual edge, and of the pairs that chose each
//! other, the cheaper half merge, but no more than are too many ([`crate::cluster::hierarchy`] without optimisation).
//! No component has a share of the clusters: each ends with those that its merges are too expensive for.

use crate::cluster::coarse::merge_cheaper_half;
use crate::device::{Cancel, Device};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::DualGraph;

/// Labels with this many clusters, whose numbers have gaps.
pub fn merged<E: Functional>(
    graph: &DualGraph<E>,
    clusters: usize,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let component_of_face = graph.component_of_face();
    let mut steps = device.open_merging(graph, &component_of_face)?;
    steps.set_labels(&(0..graph.faces() as u32).collect::<Vec<_>>())?;
    // all components share one surplus
    let shared = vec![0; graph.faces()];
    let mut surplus = [graph.faces() - clusters];
    while surplus[0] > 0 {
        cancel.check()?;
        merge_cheaper_half(steps.as_mut(), &shared, &mut surplus)?;
    }
    steps.labels()
}
