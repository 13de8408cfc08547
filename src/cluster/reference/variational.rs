//! Variational clustering with a priority queue (Cohen-Steiner, Alliez & Desbrun, "Variational Shape Approximation",
//! 2004; the paper's VC), with the energy of centroidal Voronoi diagrams.
//!
//! # Definition
//!
//! *Flooding.* Every cluster has a proxy and holds one face, its seed. Of all pairs of a face that is still free and a
//! cluster that touches it across an edge, the one with the smallest energy w·|g − P|² is taken next, the smaller face,
//! then the smaller cluster where energies are equal: that face joins that cluster. So on until no face is free. A
//! priority queue holds the pairs.
//!
//! *Beginning.* The first proxies are the centroids of the seeds.
//!
//! *Iteration.* Proxies are fitted to the clusters; the new seed of each is its face with the smallest |g − P|², the
//! smallest of equal ones; all clusters are flooded anew.
//!
//! *End.* Flooding does not have to lower F: which cluster reaches a face first also depends on the way there. So an
//! iteration counts only if F is lower after it than ever before, and the first that does not is undone and ends the
//! run. F falls in every row, and there are finitely many labellings.
//!
//! Every cluster is connected and has at least its seed, by construction.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::cluster::connected::Clusters;
use crate::cluster::flat::{Clustering, Options};
use crate::cluster::record::Record;
use crate::cluster::run::{Phase, Row};
use crate::cluster::seeds::{self, SeedFaces};
use crate::device::{Cancel, Ending, FREE};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::Items;

/// Faces between checks for cancellation.
const BETWEEN_CHECKS: usize = 1 << 16;

/// Clusters a surface from the given seeds, and keeps the labels that `record` wants. Of the options, only
/// `max_iterations` has a meaning here.
pub fn variational<E: Functional>(
    items: &Items<E>,
    seeds: &SeedFaces,
    options: Options,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
    record: &mut Record,
) -> Result<Clustering> {
    let point = |face: u32| items.points[face as usize];
    let seed = |cluster: u32| seeds.face_of_cluster[cluster as usize];
    let from_seed = |face: u32, cluster: u32| E::cost(point(face), point(seed(cluster)));
    let initial = flood(items, from_seed, &seeds.face_of_cluster, cancel)?;
    let mut best = Clusters::new(items, initial.clone());
    let mut report = |iteration: u32, clusters: &Clusters<'_, E>, moves: usize| {
        on_row(Row { iteration, round: None, phase: Phase::Regrow, energy: clusters.energy(), moves: moves as u64 });
        if record.wants(iteration) {
            record.keep(iteration, clusters.labels().to_vec());
        }
    };
    report(0, &best, 0);
    for iteration in 1..=options.max_iterations.unwrap_or(u32::MAX) {
        let from_proxy = |face: u32, cluster: u32| E::cost(point(face), best.totals(cluster).fit.0);
        let next = Clusters::new(items, flood(items, from_proxy, &central_faces(&best, from_proxy), cancel)?);
        if next.energy() <= best.energy() {
            return Ok(Clustering { initial, labels: best.labels().to_vec(), ending: Ending::Converged });
        }
        let moves = next.labels().iter().zip(best.labels()).filter(|(new, old)| new != old).count();
        best = next;
        report(iteration, &best, moves);
    }
    Ok(Clustering { initial, labels: best.labels().to_vec(), ending: Ending::IterationLimit })
}

/// The face of each cluster that is nearest to its proxy.
fn central_faces<E: Functional>(clusters: &Clusters<'_, E>, cost: impl Fn(u32, u32) -> u64) -> Vec<u32> {
    let mut nearest = vec![(u64::MAX, FREE); clusters.numbers().len()];
    for (face, &cluster) in (0..).zip(clusters.labels()) {
        let best = &mut nearest[cluster as usize];
        *best = (*best).min((cost(face, cluster), face));
    }
    nearest.into_iter().map(|(_, face)| face).collect()
}

/// The labels that flooding from `seeds` gives, where a face costs so much in a cluster, per weight.
fn flood<E: Functional>(
    items: &Items<E>,
    cost: impl Fn(u32, u32) -> u64,
    seeds: &[u32],
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let mut labels = seeds::labels(seeds, items.faces());
    let mut queue = BinaryHeap::new();
    // a face joins the cluster of its best pair, so that others need not be queued
    let mut best = vec![(u64::MAX, FREE); items.faces()];
    let mut offer = |queue: &mut BinaryHeap<_>, labels: &[u32], face: u32, cluster: u32| {
        for &near in items.neighbours_of(face) {
            let (cost, best) = (cost(near, cluster), &mut best[near as usize]);
            if labels[near as usize] == FREE && (cost, cluster) < *best {
                *best = (cost, cluster);
                let energy = u128::from(items.weights[near as usize]) * u128::from(cost);
                queue.push(Reverse((energy, near, cluster)));
            }
        }
    };
    for (cluster, &face) in seeds.iter().enumerate() {
        offer(&mut queue, &labels, face, cluster as u32);
    }
    let mut joined = 0usize;
    while let Some(Reverse((_, face, cluster))) = queue.pop() {
        if labels[face as usize] == FREE {
            labels[face as usize] = cluster;
            offer(&mut queue, &labels, face, cluster);
            joined += 1;
            if joined.is_multiple_of(BETWEEN_CHECKS) {
                cancel.check()?;
            }
        }
    }
    cancel.check()?;
    Ok(labels)
}
