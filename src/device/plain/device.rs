//! The definitions as a device, so that every driver runs on them.

use std::collections::BTreeMap;

use super::{Iterated, Refinement, explained, grow, iterate, sums};
use crate::device::dual_edge::{Rank, Ties};
use crate::device::pieces::cut_off_faces;
use crate::device::{Cancel, Device, DualEdge, Ending, FREE, MergeSteps, OnStep, Step, Steps};
use crate::device::{DeviceInfo, DeviceKind};
use crate::energy::{End, Functional, LatticeEnergy, WideSums};
use crate::error::Result;
use crate::surface::DualGraph;

/// The device whose steps are the functions of [`super`].
#[derive(Debug)]
pub struct PlainDevice {
    info: DeviceInfo,
}

impl Default for PlainDevice {
    fn default() -> Self {
        let [name, backend, driver] = ["plain", "sequential", "1 thread"].map(str::to_owned);
        Self { info: DeviceInfo { kind: DeviceKind::Cpu, name, backend, driver } }
    }
}

impl<E: Functional> Device<E> for PlainDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps<E> + 'a>> {
        Ok(open(graph, component_of_cluster))
    }
}

/// The steps on a surface: what [`PlainDevice`] opens.
pub fn open<'a, E: Functional>(
    graph: &'a DualGraph<E>,
    component_of_cluster: &'a [u32],
) -> Box<dyn MergeSteps<E> + 'a> {
    let phase = Refinement::new(graph, component_of_cluster, vec![FREE; graph.faces()]);
    Box::new(PlainSteps { labels_at_merge: phase.labels.clone(), phase, iteration: 0, is_resumed: false })
}

/// The labels of a surface, and what a phase that is resumed has refused.
struct PlainSteps<'a, E: Functional> {
    phase: Refinement<'a, E>,
    /// The labels after the last merge.
    labels_at_merge: Vec<u32>,
    /// The last iteration of the last boundary phase.
    iteration: u32,
    is_resumed: bool,
}

impl<E: Functional> PlainSteps<'_, E> {
    fn sums(&self) -> Vec<E::WideSums> {
        sums(self.phase.graph, self.phase.component_of_cluster.len(), &self.phase.labels)
    }

    /// What merge costs read of a cluster that has faces.
    fn ends(&self) -> impl Fn(u32) -> End<E::Point> + use<E> {
        let sums = (0..).zip(self.sums()).filter(|(_, sums)| sums.faces() > 0);
        let ends: BTreeMap<u32, End<E::Point>> = sums.map(|(cluster, sums)| (cluster, sums.end())).collect();
        move |cluster| ends[&cluster]
    }

    fn energy_shift(&self, cluster: u32) -> u32 {
        let component = self.phase.component_of_cluster[cluster as usize];
        self.phase.graph.components[component as usize].energy_shift
    }

    /// Every dual edge between clusters, once from each end.
    fn dual_edges(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let Refinement { graph, labels, .. } = &self.phase;
        let faces = 0..graph.faces() as u32;
        let edges = faces.flat_map(|face| graph.neighbours_of(face).iter().map(move |&near| (face, near)));
        edges.map(|(a, b)| (labels[a as usize], labels[b as usize])).filter(|(a, b)| a != b)
    }
}

/// Makes iterations until one has nothing left to do, or the limit is reached.
fn iterations(
    limit: u32,
    cancel: &Cancel,
    on_step: OnStep<'_>,
    mut iterate: impl FnMut() -> Option<Iterated>,
) -> Result<Ending> {
    for _ in 0..limit {
        cancel.check()?;
        let Some(Iterated { explained, moves, .. }) = iterate() else { return Ok(Ending::Converged) };
        on_step(Step { energy: LatticeEnergy { explained }, moves });
    }
    Ok(Ending::IterationLimit)
}

impl<E: Functional> Steps for PlainSteps<'_, E> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.phase.labels = labels.to_vec();
        self.labels_at_merge = labels.to_vec();
        self.is_resumed = false;
        Ok(())
    }

    fn relabel(&mut self, labels: &[u32]) -> Result<()> {
        self.phase.labels.copy_from_slice(labels);
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        cancel.check()?;
        self.phase.labels = grow(self.phase.graph, &self.phase.labels);
        Ok(())
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        let Refinement { graph, component_of_cluster, labels, .. } = &self.phase;
        Ok(LatticeEnergy { explained: explained(graph, component_of_cluster, labels) })
    }

    fn optimise_boundary(&mut self, limit: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        if !std::mem::take(&mut self.is_resumed) {
            self.iteration = 0;
        }
        let Self { phase: Refinement { graph, component_of_cluster, labels, .. }, iteration, .. } = self;
        iterations(limit, cancel, on_step, || {
            *iteration = iteration.saturating_add(1);
            let state = iterate(graph, component_of_cluster, labels, *iteration)?;
            labels.clone_from(&state.labels);
            Some(state)
        })
    }

    fn refine(&mut self, limit: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        if !std::mem::take(&mut self.is_resumed) {
            self.phase.refused.fill(false);
        }
        iterations(limit, cancel, on_step, || self.phase.iterate())
    }

    fn resume(&mut self) {
        self.is_resumed = true;
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        let Refinement { graph, component_of_cluster, labels, .. } = &mut self.phase;
        let cut_off = cut_off_faces(graph, component_of_cluster.len(), labels);
        cut_off.iter().for_each(|&face| labels[face as usize] = FREE);
        self.grow(cancel)?;
        Ok(cut_off.len() as u64)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        Ok(self.phase.labels.clone())
    }
}

impl<E: Functional> MergeSteps<E> for PlainSteps<'_, E> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        let end = self.ends();
        let mut best: Vec<Option<(Rank<u32>, DualEdge)>> = vec![None; self.phase.component_of_cluster.len()];
        for (cluster, other) in self.dual_edges() {
            let cost = E::packed_merge_cost(end(cluster), end(other), self.energy_shift(cluster));
            let rank = Rank::new(cost, cluster, other, ties);
            let best = &mut best[cluster as usize];
            if best.is_none_or(|(best, _)| rank < best) {
                *best = Some((rank, DualEdge { cluster, other, cost }));
            }
        }
        Ok(best.into_iter().flatten().map(|(_, edge)| edge).collect())
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        let end = self.ends();
        let rank = |(a, b): (u32, u32)| {
            let cost = E::merge_cost(end(a), end(b)) << self.energy_shift(a);
            Rank::new(cost, a.min(b), a.max(b), ties)
        };
        Ok(self.dual_edges().map(rank).min().map(|rank| rank.ends()))
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        for &(from, into) in pairs {
            self.phase.labels.iter_mut().filter(|label| **label == from).for_each(|label| *label = into);
        }
        self.labels_at_merge.clone_from(&self.phase.labels);
        Ok(())
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<E::Sums>> {
        let sums = self.sums();
        Ok(clusters.iter().map(|&cluster| sums[cluster as usize].narrow()).collect())
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        let moved =
            self.labels_at_merge.iter().zip(&self.phase.labels).enumerate().filter(|(_, (old, new))| old != new);
        Ok(moved.map(|(face, (&old, &new))| (face as u32, old, new)).collect())
    }
}
