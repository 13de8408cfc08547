//! A start by merging from single faces, over all components at once.
//!
//! Every face is a cluster. In each round every cluster finds its best dual edge, and of the pairs that chose each
//! other, some merge ([`Pairs`]), but no more than are too many (as hierarchies do without optimisation). No
//! component has a share of the clusters: each ends with those that its merges are too expensive for. Where an eighth
//! of the merges that are left should happen in a round, it is the cheaper half while there are more than twice as
//! many clusters as wanted: flat parts merge alike, and edges are decided later.
//!
//! Where thousands of clusters have no other neighbour than one, as the triangles around a large polygon, only one of
//! them would merge in a round. So after [`PAIRED_ROUNDS`] it suffices that one of two clusters chose the other.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::coarse::{Start, merge_chosen};
use super::numbers;
use crate::device::dual_edge::{Rank, Ties, keep_cheaper_half, keep_first};
use crate::device::{Cancel, Device, DualEdge};
use crate::energy::Functional;
use crate::error::{Error, Result};
use crate::surface::DualGraph;

/// Rounds from single faces, or from a stop of a hierarchy, in which both of two clusters must have chosen each other.
pub(super) const PAIRED_ROUNDS: u32 = 256;

/// Which of the pairs of clusters that chose each other merge in a parallel round.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pairs {
    /// Those that cost no more than their median
    #[default]
    CheaperHalf,
    /// All of them, as the paper does (Parallel Mesh Clustering, section 5.4)
    All,
    /// The cheapest, an eighth of the merges that are left before the next stop: more rounds, and none merges across an
    /// edge while cheaper merges wait. In place of cheaper-half for energies other than cvd
    Eighth,
}

/// How many of the merges that are left happen in a round, so that none merges across an edge while cheaper ones wait.
pub fn an_eighth(left: usize) -> usize {
    (left / 8).max(1)
}

/// Labels with this many clusters, whose numbers have gaps.
pub fn merged<E: Functional>(
    graph: &DualGraph<E>,
    clusters: usize,
    pairs: Pairs,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let component_of_face = graph.component_of_face();
    let mut for_merges = device.for_merges(graph.faces() as u64, 1);
    let device = for_merges.as_deref_mut().unwrap_or(device);
    let mut steps = device.open_merging(graph, &component_of_face)?;
    steps.set_labels(&(0..graph.faces() as u32).collect::<Vec<_>>())?;
    let mut surplus = graph.faces() - clusters;
    for _ in 0..PAIRED_ROUNDS {
        if surplus == 0 {
            break;
        }
        cancel.check()?;
        let is_far = pairs == Pairs::Eighth && surplus >= clusters;
        let pairs = if is_far { Pairs::CheaperHalf } else { pairs };
        let chosen = chosen(steps.mutual_dual_edges(Ties::Hash)?, pairs, surplus)?;
        steps.merge_pairs(&chosen)?;
        surplus -= chosen.len();
    }
    while surplus > 0 {
        cancel.check()?;
        merge_chosen(steps.as_mut(), |_| {
            let is_one_too_many = surplus > 0;
            surplus -= usize::from(is_one_too_many);
            is_one_too_many
        })?;
    }
    steps.labels()
}

/// Those of some pairs that merge in a round, the cheapest first, where clusters are too many by `surplus`.
pub(super) fn chosen(mut of: Vec<Rank<u32>>, pairs: Pairs, surplus: usize) -> Result<Vec<(u32, u32)>> {
    if of.is_empty() {
        return Err(Error::internal("there is no dual edge left to collapse"));
    }
    if pairs == Pairs::CheaperHalf {
        keep_cheaper_half(&mut of);
    }
    keep_first(&mut of, if pairs == Pairs::Eighth { an_eighth(surplus) } else { surplus });
    Ok(of.iter().map(Rank::ends).collect())
}

/// The pairs of which one chose the other; a cluster may be in several.
pub(super) fn half_mutual(edges: &[DualEdge]) -> Vec<Rank<u32>> {
    let ranked = edges.iter().map(|edge| Rank::new(edge.cost, edge.cluster, edge.other, Ties::Hash));
    let mut pairs: Vec<_> = ranked.collect();
    // two that chose each other are there twice
    pairs.sort_unstable();
    pairs.dedup();
    pairs
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
        Ok(Self::of(graph, labels, clusters as usize))
    }
}
