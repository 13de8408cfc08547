//! A device whose labels are shown while it works. Phases are interrupted as they are for snapshots: labels and
//! energies are the same with and without.

use super::Viewer;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{
    Cancel, Device, DeviceInfo, DualEdge, Ending, MemoryMeter, MergeSteps, Merges, OnStep, Profile, Steps,
};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::Result;
use crate::surface::{DualGraph, Items};

/// Iterations after which a phase is interrupted.
const AT_ONCE: u32 = 16;

/// A device that works on a job whose labels are shown, if there is a viewer.
pub(super) struct Watched<'d, E: Functional> {
    device: &'d mut dyn Device<E>,
    items: &'d Items<E>,
    viewer: Option<&'d dyn Viewer>,
    is_hierarchy: bool,
}

impl<'d, E: Functional> Watched<'d, E> {
    /// A device that works on these items.
    pub fn new(
        device: &'d mut dyn Device<E>,
        items: &'d Items<E>,
        viewer: Option<&'d dyn Viewer>,
        is_hierarchy: bool,
    ) -> Self {
        Self { device, items, viewer, is_hierarchy }
    }

    /// The viewer, where labels of a graph are labels of the items.
    fn viewer_of(&self, graph: &DualGraph<E>) -> Option<&'d dyn Viewer> {
        self.viewer.filter(|_| std::ptr::eq(graph, &raw const self.items.graph))
    }
}

impl<E: Functional> Device<E> for Watched<'_, E> {
    fn info(&self) -> &DeviceInfo {
        self.device.info()
    }

    fn another(&self) -> Option<Box<dyn Device<E>>> {
        self.device.another()
    }

    fn for_start(&self, faces: usize) -> Option<Box<dyn Device<E>>> {
        self.device.for_start(faces)
    }

    /// Its labels are not shown: no face moves there.
    fn for_merges(&self, faces: u64, left: u64) -> Option<Box<dyn Device<E>>> {
        self.device.for_merges(faces, left)
    }

    fn memory_meter(&self) -> MemoryMeter {
        self.device.memory_meter()
    }

    fn take_profile(&mut self) -> Result<Option<Profile>> {
        self.device.take_profile()
    }

    fn copy_bandwidth(&mut self) -> Result<Option<f64>> {
        self.device.copy_bandwidth()
    }

    fn open<'a>(&'a mut self, graph: &'a DualGraph<E>, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        let viewer = self.viewer_of(graph).filter(|_| !self.is_hierarchy);
        let steps = self.device.open(graph, component_of_cluster)?;
        Ok(match viewer {
            Some(viewer) => Box::new(Shown { steps, items: self.items, viewer }),
            None => steps,
        })
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps<E> + 'a>> {
        let viewer = self.viewer_of(graph).filter(|_| self.is_hierarchy);
        let steps = self.device.open_merging(graph, component_of_cluster)?;
        Ok(match viewer {
            Some(viewer) => Box::new(Shown { steps, items: self.items, viewer }),
            None => steps,
        })
    }
}

/// Steps whose labels are shown.
struct Shown<'a, E: Functional, S: ?Sized> {
    steps: Box<S>,
    items: &'a Items<E>,
    viewer: &'a dyn Viewer,
}

impl<E: Functional, S: Steps + ?Sized> Shown<'_, E, S> {
    /// Shows the labels, if that is due.
    fn show(&mut self) -> Result<()> {
        if self.viewer.is_due() {
            self.viewer.show(self.items.in_upload_order(&self.steps.labels()?));
        }
        Ok(())
    }

    /// Runs a phase, a few iterations at a time while a client watches. One that comes later waits for the next phase.
    fn phase(&mut self, max_iterations: u32, mut iterate: impl FnMut(&mut S, u32) -> Result<Ending>) -> Result<Ending> {
        let mut left = max_iterations;
        loop {
            let allowed = if self.viewer.watches() { left.min(AT_ONCE) } else { left };
            let ending = iterate(&mut self.steps, allowed)?;
            left -= allowed;
            self.show()?;
            if ending == Ending::Converged || left == 0 {
                return Ok(ending);
            }
            self.steps.resume();
        }
    }
}

impl<E: Functional, S: Steps + ?Sized> Steps for Shown<'_, E, S> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.steps.set_labels(labels)
    }

    fn relabel(&mut self, labels: &[u32]) -> Result<()> {
        self.steps.relabel(labels)
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        self.steps.grow(cancel)
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        self.steps.energy()
    }

    fn optimise_boundary(&mut self, max_iterations: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        self.phase(max_iterations, |steps, most| steps.optimise_boundary(most, cancel, on_step))
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        self.phase(max_iterations, |steps, most| steps.refine(most, cancel, on_step))
    }

    fn resume(&mut self) {
        self.steps.resume();
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        self.steps.repair(cancel)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        self.steps.labels()
    }
}

impl<E: Functional, S: MergeSteps<E> + ?Sized> MergeSteps<E> for Shown<'_, E, S> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        self.steps.optimal_dual_edges(ties)
    }

    fn mutual_dual_edges(&mut self, ties: Ties) -> Result<Vec<Rank<u32>>> {
        self.steps.mutual_dual_edges(ties)
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        self.steps.cheapest_dual_edge(ties)
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        self.steps.merge(pairs)?;
        self.show()
    }

    fn merge_pairs(&mut self, pairs: &[(u32, u32)]) -> Result<(Merges, Vec<E::Sums>)> {
        let merged = self.steps.merge_pairs(pairs)?;
        self.show()?;
        Ok(merged)
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<E::Sums>> {
        self.steps.sums_of(clusters)
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        self.steps.moves_since_merge()
    }
}
