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

use rayon::prelude::*;

use super::clusters::Clusters;
use super::totals::Totals;
use crate::device::{Cancel, Ending};
use crate::energy::{Functional, Side, Sums};
use crate::error::Result;
use crate::surface::DualGraph;

/// Faces that a thread looks at at least.
const FACES_A_THREAD: usize = 1 << 12;

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
    let faces = boundary_faces(clusters, changed);
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

/// The faces on both sides of the boundaries of some clusters, ascending.
fn boundary_faces<E: Functional>(clusters: &Clusters<'_, E>, of: &[u32]) -> Vec<u32> {
    let inside: usize = of.iter().map(|&cluster| clusters.faces(cluster).len()).sum();
    if inside * 4 > clusters.labels().len() * 3 { among_all(clusters, of) } else { along_lists(clusters, of) }
}

/// The same, by the lists of the clusters.
fn along_lists<E: Functional>(clusters: &Clusters<'_, E>, of: &[u32]) -> Vec<u32> {
    let mut faces = Vec::new();
    for &cluster in of {
        for &face in clusters.faces(cluster) {
            let before = faces.len();
            let beside = clusters.graph.neighbours_of(face).iter();
            faces.extend(beside.filter(|&&near| clusters.label(near) != cluster));
            if faces.len() > before {
                faces.push(face);
            }
        }
    }
    faces.sort_unstable();
    faces.dedup();
    faces
}

/// The same, for clusters that have more than three quarters of the faces: it looks at all in their order, by all
/// threads, and sorts none.
fn among_all<E: Functional>(clusters: &Clusters<'_, E>, of: &[u32]) -> Vec<u32> {
    let mut is_of = vec![false; clusters.numbers().len()];
    of.iter().for_each(|&cluster| is_of[cluster as usize] = true);
    let is_at_boundary = |face: &u32| {
        let label = clusters.label(*face);
        let is_own = is_of[label as usize];
        let mut beside = clusters.graph.neighbours_of(*face).iter().map(|&near| clusters.label(near));
        beside.any(|near| near != label && (is_own || is_of[near as usize]))
    };
    (0..clusters.labels().len() as u32).into_par_iter().with_min_len(FACES_A_THREAD).filter(is_at_boundary).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::Sample;
    use crate::surface::tests::of_sample;

    #[test]
    fn boundary_faces_are_the_same_along_lists_and_among_all() {
        let surface = of_sample(Sample::Parts, 20_000);
        let labels = (0..surface.faces() as u32).map(|face| face / 300).collect();
        let clusters = Clusters::new(&surface, labels);
        let all = clusters.numbers();
        for step in [1, 2, 7, 1000] {
            let of: Vec<u32> = all.clone().step_by(step).collect();
            let faces = along_lists(&clusters, &of);
            assert_eq!(faces, among_all(&clusters, &of));
            assert!(!faces.is_empty() && faces.len() < surface.faces(), "{step}: {} faces", faces.len());
        }
        assert_ne!(along_lists(&clusters, &[0]), among_all(&clusters, &[1]));
    }
}
