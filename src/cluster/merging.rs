//! A start by merging from single faces, over all components at once.
//!
//! Every face is a cluster. In each round every cluster finds its best dual edge, and of the pairs that chose each
//! other, some merge ([`Pairs`]), but no more than are too many ([`super::hierarchy`] without optimisation). No
//! component has a share of the clusters: each ends with those that its merges are too expensive for.

use super::coarse::Start;
use super::hierarchy::Pairs;
use super::numbers;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, Device, MergeSteps};
use crate::energy::Functional;
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// Labels with this many clusters, whose numbers have gaps.
pub fn merged<E: Functional>(
    graph: &DualGraph<E>,
    clusters: usize,
    pairs: Pairs,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let component_of_face = graph.component_of_face();
    let mut steps = device.open_merging(graph, &component_of_face)?;
    steps.set_labels(&(0..graph.faces() as u32).collect::<Vec<_>>())?;
    let mut surplus = graph.faces() - clusters;
    while surplus > 0 {
        cancel.check()?;
        let chosen = chosen_pairs(steps.as_mut(), Ties::Hash, pairs, surplus)?;
        steps.merge_pairs(&chosen)?;
        surplus -= chosen.len();
    }
    steps.labels()
}

/// The pairs that merge in a round, the cheapest first, where clusters are too many by `surplus`.
pub(super) fn chosen_pairs<E: Functional>(
    steps: &mut dyn MergeSteps<E>,
    ties: Ties,
    pairs: Pairs,
    surplus: usize,
) -> Result<Vec<(u32, u32)>> {
    let mut mutual = steps.mutual_dual_edges(ties)?;
    if mutual.is_empty() {
        return Err(Error::new(Kind::Internal, "no two clusters chose each other"));
    }
    pairs.choose(&mut mutual, surplus);
    Ok(mutual.iter().map(Rank::ends).collect())
}

impl Start {
    /// From this many clusters that were merged from single faces. The numbers must be possible
    /// ([`super::seeds::shares`]).
    pub fn merged<E: Functional>(
        graph: &DualGraph<E>,
        clusters: u64,
        pairs: Pairs,
        device: &mut dyn Device<E>,
        cancel: &Cancel,
    ) -> Result<Self> {
        let labels = numbers::compact(&merged(graph, clusters as usize, pairs, device, cancel)?);
        let mut component_of_cluster = vec![0; clusters as usize];
        for (number, component) in (0..).zip(&graph.components) {
            component.range().for_each(|face| component_of_cluster[labels[face] as usize] = number);
        }
        Ok(Self { labels, component_of_cluster })
    }
}
