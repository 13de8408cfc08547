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

use super::partition::Partition;
use crate::cluster::flat::{Clustering, Options};
use crate::cluster::record::Record;
use crate::cluster::run::{Phase, Row};
use crate::cluster::seeds::{self, SeedFaces};
use crate::device::{Cancel, Ending, FREE};
use crate::energy::Functional;
use crate::error::{Error, Result};
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
    let component_of_cluster = &seeds.component_of_cluster;
    let fitted = |labels: Vec<u32>| Partition::new(items, component_of_cluster, labels);
    let row = |iteration: u32, partition: &Partition<'_, E>, moves: u64| {
        let energy = partition.energy();
        Row { iteration, round: None, phase: Phase::Regrow, energy, moves }
    };
    let alone = fitted(seeds.labels(items.faces()));
    let mut best = fitted(flood(items, &alone, &seeds.face_of_cluster, cancel)?);
    let initial = best.labels.clone();
    on_row(row(0, &best, 0));
    record.offer(0, || Ok::<_, Error>(best.labels.clone()))?;
    for iteration in 1..=options.max_iterations.unwrap_or(u32::MAX) {
        let next = fitted(flood(items, &best, &central_faces(&best), cancel)?);
        if next.energy() <= best.energy() {
            return Ok(Clustering { initial, labels: best.labels, ending: Ending::Converged });
        }
        let moves = next.labels.iter().zip(&best.labels).filter(|(new, old)| new != old).count();
        best = next;
        on_row(row(iteration, &best, moves as u64));
        record.offer(iteration, || Ok::<_, Error>(best.labels.clone()))?;
    }
    Ok(Clustering { initial, labels: best.labels, ending: Ending::IterationLimit })
}

/// The face of each cluster that is nearest to its proxy.
fn central_faces<E: Functional>(partition: &Partition<'_, E>) -> Vec<u32> {
    let mut nearest = vec![(u64::MAX, FREE); partition.clusters()];
    for (face, &cluster) in partition.labels.iter().enumerate() {
        let face = face as u32;
        let best = &mut nearest[cluster as usize];
        *best = (*best).min((partition.cost(face, cluster), face));
    }
    nearest.into_iter().map(|(_, face)| face).collect()
}

/// The labels that flooding from `seeds` with the proxies of `fitted` gives.
fn flood<E: Functional>(
    items: &Items<E>,
    fitted: &Partition<'_, E>,
    seeds: &[u32],
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let mut labels = seeds::labels(seeds, items.faces());
    let mut queue = BinaryHeap::new();
    // a face joins the cluster of its best pair, so that others need not be queued
    let mut best = vec![(u64::MAX, FREE); items.faces()];
    let mut offer = |queue: &mut BinaryHeap<_>, labels: &[u32], face: u32, cluster: u32| {
        for &near in items.neighbours_of(face) {
            let (cost, best) = (fitted.cost(near, cluster), &mut best[near as usize]);
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
