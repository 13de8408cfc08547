//! Paying swaps: two clusters become one, and a third becomes two, where that lowers F at once.
//!
//! # Definition
//!
//! A round:
//!
//! 1. Every cluster finds its cheapest merge, with cost F_ab − F_a − F_b. Every cluster whose splits
//!    [might gain](Clusters::may_gain) more than the cheapest merge of all finds its best [split](super::split), with
//!    gain F_c − F_1 − F_2. All are exact integers in the unit of the finest component.
//! 2. Merges, the cheapest first, meet splits, those that gain most first; ties go by number. A cluster takes part
//!    once. The round ends at the first merge that costs as much as the best split left gains.
//! 3. Each swap merges its pair, and the number that becomes free names the new part of the split cluster, in whatever
//!    component that is. Then the clusters [settle](mod@crate::cluster::connected::settle).
//!
//! Rounds go on until no swap pays, [`ROUNDS`] at most.
//!
//! # F falls, and the rounds end
//!
//! F is a sum over clusters, and no cluster takes part in two swaps, so the changes of a round add up exactly; each is
//! negative. Settling lowers F, too. F is an integer that is not negative.

use super::offers::Offers;
use crate::cluster::connected::Clusters;
use crate::cluster::connected::settle::settle;
use crate::device::Cancel;
use crate::energy::{Bounds, Functional};
use crate::error::Result;
use crate::parallel;
use crate::surface::DualGraph;

/// Rounds at most.
const ROUNDS: u32 = 32;

/// Faces that a thread takes at least.
const CHUNK: usize = 1 << 13;

/// Makes rounds; `on_round` is called after each with swaps.
pub fn swap<E: Functional>(
    offers: &mut Offers<'_, E>,
    cancel: &Cancel,
    mut on_round: impl FnMut(&mut Clusters<'_, E>),
) -> Result<()> {
    for _ in 0..ROUNDS {
        cancel.check()?;
        let swaps = paying(offers);
        if swaps.is_empty() {
            return Ok(());
        }
        let mut changed = Vec::with_capacity(3 * swaps.len());
        for (a, b, split) in swaps {
            changed.extend([offers.clusters.merge(a, b), split, offers.split(split)]);
        }
        settle(&mut offers.clusters, changed, u32::MAX, cancel)?;
        on_round(&mut offers.clusters);
    }
    offers.clusters.faces_left = 0;
    Ok(())
}

/// The swaps of a round: the pair that merges, and the cluster that is split.
fn paying<E: Functional>(offers: &mut Offers<'_, E>) -> Vec<(u32, u32, u32)> {
    let merges = offers.merges();
    let Some(&(least, ..)) = merges.first() else { return Vec::new() };
    let splits = offers.splits(|clusters, cluster| clusters.may_gain(least, cluster));
    let mut is_taken = vec![false; offers.clusters.numbers().len()];
    let mut swaps = Vec::new();
    let mut first = 0;
    for (cost, a, b) in merges {
        if is_taken[a as usize] || is_taken[b as usize] {
            continue;
        }
        first += splits[first..].iter().take_while(|&&(_, cluster)| is_taken[cluster as usize]).count();
        if splits.get(first).is_none_or(|&(gain, _)| gain <= cost) {
            break;
        }
        let mut paying = splits[first..].iter().take_while(|&&(gain, _)| gain > cost).map(|&(_, cluster)| cluster);
        let is_apart = |&cluster: &u32| !is_taken[cluster as usize] && cluster != a && cluster != b;
        if let Some(split) = paying.find(is_apart) {
            [a, b, split].into_iter().for_each(|cluster| is_taken[cluster as usize] = true);
            swaps.push((a, b, split));
        }
    }
    swaps
}

/// Whether a swap might pay: whether a split might gain more than the cheapest merge costs. Every cluster has faces,
/// and every face a cluster.
///
/// One pass over the faces shows that none pays on even meshes, where a round would first make lists of faces, merges
/// and splits (`benches/results/2026-11-23-two-cores/swaps.md`).
pub fn may_pay<E: Functional>(graph: &DualGraph<E>, labels: &[u32], clusters: usize) -> bool {
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
    parallel::any(labels.len(), CHUNK, &|mut faces| {
        faces.any(|face| {
            let own = labels[face];
            let others = graph.neighbours_of(face as u32).iter().map(|&near| labels[near as usize]);
            others.filter(|&other| other < own).any(|other| is_cheap(own, other))
        })
    })
}
