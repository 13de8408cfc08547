//! A start by merging from single faces, over all components at once.
//!
//! Every face is a cluster. In each round every cluster finds its best dual edge, and of the pairs that chose each
//! other, the cheaper half merge, but no more than are too many ([`crate::cluster::hierarchy`] without optimisation).
//! No component has a share of the clusters: each ends with those that its merges are too expensive for.

use crate::device::dual_edge::{Rank, Ties, keep_cheaper_half};
use crate::device::{Cancel, Device};
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// Labels with this many clusters, whose numbers have gaps.
pub fn merged(graph: &DualGraph, clusters: usize, device: &mut dyn Device, cancel: &Cancel) -> Result<Vec<u32>> {
    let component_of_face = graph.component_of_face();
    let mut steps = device.open_merging(graph, &component_of_face)?;
    steps.set_labels(&(0..graph.faces() as u32).collect::<Vec<_>>())?;
    let mut left = graph.faces();
    while left > clusters {
        cancel.check()?;
        let mut mutual = steps.mutual_dual_edges(Ties::Hash)?;
        if mutual.is_empty() {
            return Err(Error::new(Kind::Internal, "no two clusters chose each other"));
        }
        keep_cheaper_half(&mut mutual);
        mutual.sort_unstable();
        mutual.truncate(left - clusters);
        left -= mutual.len();
        steps.merge_pairs(&mutual.iter().map(Rank::ends).collect::<Vec<_>>())?;
    }
    steps.labels()
}
