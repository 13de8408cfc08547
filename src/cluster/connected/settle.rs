//! Connected refinement on the host: faces move one after the other, and every cluster stays connected.
//!
//! # Definition
//!
//! A pass looks, in their order, at the faces at the boundaries of the clusters that changed in the pass before (at
//! first, those that the caller names). A face considers the clusters of its neighbours and takes the one with the
//! largest gain ([`crate::cluster::refinement`]; the smaller number of equal ones). It moves at once if F falls,
//! exactly, and its cluster is seen to stay connected ([`super::connection`]). Passes end with one in which nothing
//! moves, or where the clusters have [no work left](Clusters::spend).
//!
//! As code: [`crate::device::plain::ConnectedMoves`]. `docs/uneven.md` says why clusters stay connected, why none gets
//! empty and why passes end.

use std::cmp::Reverse;

use super::clusters::Clusters;
use super::totals::Totals;
use crate::device::{Cancel, Ending};
use crate::energy::{Functional, Side, Sums};
use crate::error::Result;
use crate::surface::DualGraph;

/// Labels after all clusters have settled, and whether a bound on work ended that.
pub fn settled<E: Functional>(graph: &DualGraph<E>, labels: Vec<u32>, cancel: &Cancel) -> Result<(Vec<u32>, Ending)> {
    let mut clusters = Clusters::new(graph, labels);
    let all = clusters.numbers().collect();
    settle(&mut clusters, all, u32::MAX, cancel)?;
    Ok((clusters.labels().to_vec(), clusters.ending()))
}

/// Settles the borders of some clusters, and of those that change with them.
pub fn settle<E: Functional>(
    clusters: &mut Clusters<'_, E>,
    mut changed: Vec<u32>,
    most_passes: u32,
    cancel: &Cancel,
) -> Result<()> {
    for _ in 0..most_passes {
        if changed.is_empty() {
            break;
        }
        cancel.check()?;
        changed = pass(clusters, &changed);
    }
    Ok(())
}

/// Makes one pass. Returns the clusters that changed, ascending.
pub fn pass<E: Functional>(clusters: &mut Clusters<'_, E>, changed: &[u32]) -> Vec<u32> {
    let faces = clusters.around(changed);
    if !clusters.spend(changed, &faces) {
        return Vec::new();
    }
    let mut next = Vec::new();
    for face in faces {
        let from = clusters.label(face);
        if let Some(to) = best_move(clusters, face)
            && clusters.move_if_lower(face, to)
        {
            next.extend([from, to]);
        }
    }
    next.sort_unstable();
    next.dedup();
    next
}

/// The neighbouring cluster with the largest gain for a face, if that is positive.
fn best_move<E: Functional>(clusters: &Clusters<'_, E>, face: u32) -> Option<u32> {
    let graph = clusters.graph;
    let from = clusters.label(face);
    let side = |cluster: u32| {
        let Totals { fit, sums, .. } = clusters.totals(cluster);
        Side { cost: E::cost(graph.points[face as usize], fit.0), weight: sums.weight() }
    };
    let weight = graph.weights[face as usize];
    let own = side(from);
    if own.weight == u64::from(weight) {
        return None;
    }
    let mut last = from;
    let mut best: Option<(i64, Reverse<u32>)> = None;
    for &near in graph.neighbours_of(face) {
        let to = clusters.label(near);
        if to != from && to != last {
            best = best.max(Some((E::gain(weight, own, side(to)), Reverse(to))));
            last = to;
        }
    }
    best.filter(|&(gain, _)| gain > 0).map(|(_, Reverse(to))| to)
}
