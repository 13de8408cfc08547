//! Coarse to fine: a start for flat clusterings that lies near a lower minimum, and costs less to reach.
//!
//! # Definition
//!
//! Numbers are those of the default [`Effort`]; [`super::quality`] has the others.
//!
//! 1. *Coarsening.* Neighbouring faces are grouped ([`crate::surface::Coarse`]), then groups, until less than a third
//!    would go. No group weighs more than 1/16 of the mean cluster of its component (less with fewer than 64 clusters:
//!    there are some 1,000 groups then), and a component that would be left with fewer groups than two a cluster,
//!    because most of its faces weigh next to nothing, stays as it is.
//! 2. *Too many clusters.* On the coarsest graph, a third more than are wanted start from stratified seeds and grow.
//! 3. *Merging.* The boundary phase ([`super::flat`]) makes four iterations. Every cluster finds its best dual edge
//!    ([`crate::device::dual_edge`]); of the mutual pairs, the cheaper half merge; and so on until there are as many
//!    clusters as wanted. No component goes below its share. Then the boundary phase runs to its end, and pieces are
//!    repaired, before energies are compared. Where few clusters are wanted, clusters teleport ([`super::teleport`]),
//!    800 / k times, and 2. and 3. are done for as many seed numbers; the start with the lowest energy is taken.
//! 4. *Back to the faces.* Labels go to the next finer graph, where the boundary phase runs; on the finest, they are
//!    where the clustering starts.
//!
//! # Why
//!
//! A flat clustering from k seeds keeps the irregularities that it starts with: its moves shift boundaries, and never
//! take a cluster from where there are too many to where there are too few. Merging does. Where a cluster has sixteen
//! groups instead of a hundred faces, the rounds are cheap. Energies end below those of the next best seeds, and below
//! ACVD's (`benches/results/choices.md`, with what else was tried).

use super::run::Run;
use super::seeds::{self, SeedFaces};
use super::teleport::Teleports;
use crate::device::dual_edge::{Rank, Ties, keep_cheaper_half};
use crate::device::{Cancel, Device, DualEdge, Ending, MergeSteps, Steps};
use crate::energy::{Energy, Functional, LatticeEnergy};
use crate::error::{Error, Result};
use crate::parallel;
use crate::surface::{Coarse, DualGraph, Items, number_by_first_face};
use crate::union_find;

/// How much work a start may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// A group weighs no more than the mean cluster of its component over this.
    pub groups_a_cluster: u64,
    /// Groups in all, where that many are possible: with fewer, the energies of starts do not tell which of them ends
    /// lowest on the faces.
    pub least_groups: u64,
    /// Clusters to begin with beyond those that are wanted, in percent of those.
    pub surplus_percent: usize,
    /// Iterations at most between two rounds of merges.
    pub iterations_a_round: u32,
    /// Iterations at most on a coarse graph when there is nothing left to merge.
    pub iterations_a_graph: u32,
    /// Refine what the boundary phases on coarse graphs have converged to.
    pub refine: bool,
    /// Rounds of teleports ([`super::teleport`]) on the coarsest graph, for any number of clusters.
    pub teleport_rounds: u64,
    /// Starts are made from several seed numbers as long as they have no more clusters than this together; the one with
    /// the lowest energy is taken. Each has as many rounds of teleports more, [`MOST_TELEPORT_ROUNDS`] at most.
    pub clusters_in_starts: u64,
}

/// The first round teleports one cluster in 20. A round that does not lower the energy halves that for the next.
const TELEPORTS_OF: usize = 20;

/// Rounds of teleports at most.
const MOST_TELEPORT_ROUNDS: u64 = 12;

/// Rounds of merges in which both of two clusters must have chosen each other; [`super::merging`] says why.
const PAIRED_ROUNDS: u32 = 32;

/// Starts have no more faces of the coarsest graph together than this, or than the mesh has; one there is in any case.
const FACES_IN_STARTS: u64 = 20_000;

/// Starts at most.
const MOST_STARTS: u64 = 16;

/// A coarse start, prepared without a device.
#[derive(Debug)]
pub struct CoarseStart<E: Functional = Energy> {
    /// Coarser and coarser graphs.
    levels: Vec<Coarse<E>>,
    /// The seeds of each start on the coarsest graph, more than wanted.
    seeds: Vec<SeedFaces>,
    /// How many clusters each component has in the end.
    shares: Vec<usize>,
    teleport_rounds: u64,
    effort: Effort,
}

/// Where a flat clustering begins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Start {
    /// One label a face, or [`crate::device::FREE`]; internal order.
    pub labels: Vec<u32>,
    /// The component that each cluster lies in.
    pub component_of_cluster: Vec<u32>,
    /// Whether a bound on work cut steps short that led to it.
    pub is_bounded: bool,
}

impl Start {
    /// From labels, which have this many clusters.
    pub fn of<E: Functional>(graph: &DualGraph<E>, labels: Vec<u32>, clusters: usize) -> Self {
        Self { component_of_cluster: graph.component_of_cluster(&labels, clusters), labels, is_bounded: false }
    }
}

impl<E: Functional> CoarseStart<E> {
    /// Coarsens a surface for `clusters` clusters and chooses seeds on the coarsest graph.
    pub fn new(items: &Items<E>, clusters: u64, seed: u64, effort: Effort) -> Result<Self> {
        let shares = seeds::shares(items, clusters)?;
        let least_groups = effort.least_groups.min(items.faces() as u64 / 2);
        let groups_a_cluster = effort.groups_a_cluster.max(least_groups / clusters);
        let mut heaviest: Vec<u64> = items
            .components
            .iter()
            .zip(&shares)
            .map(|(component, &share)| component.weight / (groups_a_cluster * share as u64))
            .collect();
        let mut levels: Vec<Coarse<E>> = Vec::new();
        loop {
            let graph = levels.last().map_or(&items.graph, |level| &level.graph);
            let is_coarse = |groups: u64| groups * 3 > graph.faces() as u64 * 2;
            if is_coarse(graph.least_groups(&heaviest)) {
                break;
            }
            let mut grouping = graph.grouped(&heaviest);
            let mut has_too_few = false;
            for ((groups, &share), heaviest) in grouping.groups_of_components().zip(&shares).zip(&mut heaviest) {
                if *heaviest > 0 && (groups as usize) < 2 * share {
                    *heaviest = 0;
                    has_too_few = true;
                }
            }
            if has_too_few {
                grouping = graph.grouped(&heaviest);
            }
            if is_coarse(u64::from(grouping.groups())) {
                break;
            }
            levels.push(graph.contracted(grouping));
        }
        let coarsest = levels.last().map_or(&items.graph, |level| &level.graph);
        let too_many: Vec<usize> = shares
            .iter()
            .zip(&coarsest.components)
            .map(|(&share, component)| (share + share * effort.surplus_percent / 100).min(component.faces as usize))
            .collect();
        let affordable = (items.faces() as u64).max(FACES_IN_STARTS) / coarsest.faces() as u64;
        let repeats = (effort.clusters_in_starts / clusters).min(MOST_STARTS).min(affordable);
        let seeds = |start| seeds::stratified(coarsest, &too_many, seed.wrapping_add(start << 32));
        let seeds = (0..repeats.max(1)).map(seeds).collect();
        let teleport_rounds = (effort.teleport_rounds + repeats).min(MOST_TELEPORT_ROUNDS);
        Ok(Self { levels, seeds, shares, teleport_rounds, effort })
    }

    /// Makes the start on a device. Each coarse graph is freed as soon as its labels are on the next finer one.
    pub fn labels(mut self, items: &Items<E>, device: &mut dyn Device<E>, cancel: &Cancel) -> Result<Start> {
        let coarsest = self.levels.last().map_or(&items.graph, |level| &level.graph);
        // each start has a device of its own, where another one costs nothing
        let others: Option<Vec<Box<dyn Device<E>>>> =
            self.seeds.iter().map(|_| device.for_start(coarsest.faces())).collect();
        let started: Result<Vec<(LatticeEnergy, Start)>> = match others {
            Some(mut others) => {
                let started = parallel::runs_mut(&mut others, 1, &|first, devices| {
                    let starts = self.seeds[first..].iter().zip(devices);
                    starts.map(|(seeds, device)| self.merged(coarsest, seeds, device.as_mut(), cancel)).collect()
                });
                parallel::joined(started).into_iter().collect()
            }
            None => self.seeds.iter().map(|seeds| self.merged(coarsest, seeds, device, cancel)).collect(),
        };
        // in reverse, so that the first of equal ones is taken
        let best = started?.into_iter().rev().max_by_key(|&(energy, _)| energy);
        let (_, mut start) = best.ok_or_else(|| Error::internal("there is no start"))?;
        while let Some(coarse) = self.levels.pop() {
            start.labels = coarse.refined(&start.labels);
            drop(coarse);
            if let Some(Coarse { graph, .. }) = self.levels.last() {
                let mut other = device.for_start(graph.faces());
                let device = other.as_deref_mut().unwrap_or(device);
                let mut steps = device.open(graph, &start.component_of_cluster)?;
                steps.set_labels(&start.labels)?;
                self.optimise(graph, steps.as_mut(), self.effort.iterations_a_graph, cancel)?;
                start.labels = steps.labels()?;
            }
        }
        Ok(start)
    }

    /// The phases on a coarse graph, and a repair: a cluster in pieces has an energy that it cannot keep. Where
    /// iterations are limited, no energies are compared, and nothing is repaired.
    fn settle(&self, graph: &DualGraph<E>, steps: &mut dyn Steps, cancel: &Cancel) -> Result<Ending> {
        if self.effort.iterations_a_graph < u32::MAX {
            return self.optimise(graph, steps, self.effort.iterations_a_graph, cancel);
        }
        Run::new(steps, cancel, &mut |_| {}).complete(graph, false, |run| run.optimise(graph, self.effort.refine))
    }

    /// The phases on a coarse graph, with so many iterations at most.
    fn optimise(&self, graph: &DualGraph<E>, steps: &mut dyn Steps, most: u32, cancel: &Cancel) -> Result<Ending> {
        Run { left: most, ..Run::new(steps, cancel, &mut |_| {}) }.optimise(graph, self.effort.refine)
    }

    /// Clusters of the coarsest graph, as many as wanted, numbered in the order of their first faces; and what they
    /// explain.
    fn merged(
        &self,
        graph: &DualGraph<E>,
        seeds: &SeedFaces,
        device: &mut dyn Device<E>,
        cancel: &Cancel,
    ) -> Result<(LatticeEnergy, Start)> {
        let component_of_cluster = &seeds.component_of_cluster;
        let mut steps = device.open_merging(graph, component_of_cluster)?;
        steps.set_labels(&seeds.labels(graph.faces()))?;
        steps.grow(cancel)?;
        let mut surplus = vec![0usize; self.shares.len()];
        component_of_cluster.iter().for_each(|&component| surplus[component as usize] += 1);
        surplus.iter_mut().zip(&self.shares).for_each(|(surplus, share)| *surplus -= share);
        let mut rounds = 0..PAIRED_ROUNDS;
        while surplus.iter().any(|&surplus| surplus > 0) {
            self.optimise(graph, steps.as_mut(), self.effort.iterations_a_round, cancel)?;
            match rounds.next() {
                Some(_) => merge_cheaper_half(steps.as_mut(), component_of_cluster, &mut surplus)?,
                None => merge_chosen(steps.as_mut(), |cluster| take(&mut surplus, component_of_cluster, cluster))?,
            }
        }
        self.settle(graph, steps.as_mut(), cancel)?;
        let (energy, mut labels) = self.teleported(graph, component_of_cluster, steps.as_mut(), cancel)?;
        number_by_first_face(&mut labels, component_of_cluster.len());
        Ok((energy, Start::of(graph, labels, self.shares.iter().sum())))
    }

    /// Teleports clusters, as long as that lowers the energy and effort allows. Labels and what they explain; the
    /// device may be left with others.
    fn teleported(
        &self,
        graph: &DualGraph<E>,
        component_of_cluster: &[u32],
        steps: &mut dyn MergeSteps<E>,
        cancel: &Cancel,
    ) -> Result<(LatticeEnergy, Vec<u32>)> {
        let mut best = (steps.energy()?, steps.labels()?);
        let mut most = self.shares.iter().sum::<usize>().div_ceil(TELEPORTS_OF);
        // the teleports of the best labels, if they were computed before
        let mut known: Option<Teleports<'_, E>> = None;
        for _ in 0..self.teleport_rounds {
            let teleports = match known.take() {
                Some(teleports) => teleports,
                None => {
                    let edges = steps.optimal_dual_edges(Ties::Hash)?;
                    Teleports::of(graph, &best.1, component_of_cluster, &edges)
                }
            };
            let Some(labels) = teleports.made(&best.1, most) else {
                break;
            };
            steps.set_labels(&labels)?;
            self.settle(graph, steps, cancel)?;
            let energy = steps.energy()?;
            if energy > best.0 {
                best = (energy, steps.labels()?);
            } else if most > 1 {
                most /= 2;
                known = Some(teleports);
            } else {
                break;
            }
        }
        Ok(best)
    }
}

/// Merges the cheaper half of the mutual pairs; in each component at most its surplus, which falls by that.
fn merge_cheaper_half<E: Functional>(
    steps: &mut dyn MergeSteps<E>,
    component_of_cluster: &[u32],
    surplus: &mut [usize],
) -> Result<()> {
    let mut mutual = steps.mutual_dual_edges(Ties::Hash)?;
    mutual.retain(|pair| surplus[component_of_cluster[pair.ends().0 as usize] as usize] > 0);
    keep_cheaper_half(&mut mutual);
    mutual.sort_unstable();
    mutual.retain(|pair| take(surplus, component_of_cluster, pair.ends().0));
    if mutual.is_empty() {
        return Err(Error::internal("no two clusters chose each other"));
    }
    let pairs: Vec<(u32, u32)> = mutual.iter().map(Rank::ends).collect();
    steps.merge_pairs(&pairs)?;
    Ok(())
}

/// Merges clusters with the neighbours that they chose, the cheapest first, each if `may_merge` then says so.
pub(super) fn merge_chosen<E: Functional>(
    steps: &mut dyn MergeSteps<E>,
    mut may_merge: impl FnMut(u32) -> bool,
) -> Result<()> {
    let mut chosen = steps.optimal_dual_edges(Ties::Hash)?;
    chosen.sort_unstable_by_key(|edge| (edge.cost, edge.cluster));
    let mut labels = steps.labels()?;
    let mut merged_into = union_find::singletons(labels.iter().map(|&label| label as usize + 1).max().unwrap_or(0));
    let mut has_merged = false;
    for DualEdge { cluster, other, .. } in chosen {
        let [one, another] = [cluster, other].map(|cluster| union_find::root(&mut merged_into, cluster));
        has_merged |= one != another && may_merge(cluster) && union_find::join(&mut merged_into, one, another);
    }
    if !has_merged {
        return Err(Error::internal("there is no dual edge left to collapse"));
    }
    labels.iter_mut().for_each(|label| *label = union_find::root(&mut merged_into, *label));
    steps.set_labels(&labels)
}

/// Lowers the surplus of a cluster's component. Returns whether there was one.
fn take(surplus: &mut [usize], component_of_cluster: &[u32], cluster: u32) -> bool {
    let surplus = &mut surplus[component_of_cluster[cluster as usize] as usize];
    let has_surplus = *surplus > 0;
    *surplus -= usize::from(has_surplus);
    has_surplus
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::quality::Quality;
    use crate::cluster::relocation::tests::uneven;
    use crate::dev::sample::Sample;
    use crate::device::cpu::CpuDevice;
    use crate::surface::tests::{assert_clusters_lie_in, of_sample};

    #[test]
    fn every_number_of_clusters_is_met_whatever_the_faces_weigh() {
        for (sample, faces) in [(Sample::Sphere, 80), (Sample::Parts, 250), (Sample::Strip, 12), (Sample::Cube, 12)] {
            let even = of_sample(sample, faces);
            for (surface, quality) in [(even, Quality::Default), (uneven(sample, faces), Quality::Best)] {
                for clusters in surface.components.len()..=surface.faces() {
                    let plan = CoarseStart::new(&surface, clusters as u64, 3, quality.start(surface.moves))
                        .expect("that many are possible");
                    let start =
                        plan.labels(&surface, &mut CpuDevice::new(), &Cancel::default()).expect("no cancellation");
                    assert_eq!(start.component_of_cluster.len(), clusters);
                    assert_clusters_lie_in(&surface, &start.labels, &start.component_of_cluster);
                    let mut shares = vec![0; surface.components.len()];
                    start.component_of_cluster.iter().for_each(|&component| shares[component as usize] += 1);
                    assert_eq!(shares, seeds::shares(&surface, clusters as u64).expect("as above"));
                }
            }
        }
    }
}
