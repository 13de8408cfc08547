//! A device whose labels are shown while it works. Phases are interrupted as they are for snapshots: labels and
//! energies are the same with and without.

use tesserae_mesh::device::dual_edge::{Rank, Ties};
use tesserae_mesh::device::{
    Cancel, Device, DeviceInfo, DualEdge, Ending, MemoryMeter, MergeSteps, Merges, OnStep, Profile, Steps,
};
use tesserae_mesh::energy::{ClusterSums, LatticeEnergy};
use tesserae_mesh::error::Result;
use tesserae_mesh::job::{Plan, Prepared, Viewer};
use tesserae_mesh::surface::{DualGraph, Surface};

/// Iterations after which a phase is interrupted.
const AT_ONCE: u32 = 16;

/// A device that works on a job whose labels are shown.
pub(super) struct Watched<'d> {
    device: &'d mut dyn Device,
    surface: &'d Surface,
    viewer: &'d dyn Viewer,
    is_hierarchy: bool,
}

impl<'d> Watched<'d> {
    /// None where the labels are not shown.
    pub fn new(device: &'d mut dyn Device, prepared: &'d Prepared) -> Option<Self> {
        let Prepared { surface, plan, viewer, .. } = prepared;
        let viewer = viewer.as_deref()?;
        Some(Self { device, surface, viewer, is_hierarchy: matches!(plan, Plan::Hierarchy { .. }) })
    }

    /// Whether labels of a graph are labels of the mesh.
    fn shows(&self, graph: &DualGraph) -> bool {
        std::ptr::eq(graph, &raw const self.surface.graph)
    }
}

impl Device for Watched<'_> {
    fn info(&self) -> &DeviceInfo {
        self.device.info()
    }

    fn another(&self) -> Option<Box<dyn Device>> {
        self.device.another()
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

    fn open<'a>(&'a mut self, graph: &'a DualGraph, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        let is_shown = self.shows(graph) && !self.is_hierarchy;
        let steps = self.device.open(graph, component_of_cluster)?;
        Ok(if is_shown { Box::new(Shown { steps, surface: self.surface, viewer: self.viewer }) } else { steps })
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps + 'a>> {
        let is_shown = self.shows(graph) && self.is_hierarchy;
        let steps = self.device.open_merging(graph, component_of_cluster)?;
        Ok(if is_shown { Box::new(Shown { steps, surface: self.surface, viewer: self.viewer }) } else { steps })
    }
}

/// Steps whose labels are shown.
struct Shown<'a, S: ?Sized> {
    steps: Box<S>,
    surface: &'a Surface,
    viewer: &'a dyn Viewer,
}

impl<S: Steps + ?Sized> Shown<'_, S> {
    /// Shows the labels, if that is due.
    fn show(&mut self) -> Result<()> {
        if self.viewer.is_due() {
            self.viewer.show(self.surface.in_upload_order(&self.steps.labels()?));
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

impl<S: Steps + ?Sized> Steps for Shown<'_, S> {
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

impl<S: MergeSteps + ?Sized> MergeSteps for Shown<'_, S> {
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

    fn merge_pairs(&mut self, pairs: &[(u32, u32)]) -> Result<(Merges, Vec<ClusterSums>)> {
        let merged = self.steps.merge_pairs(pairs)?;
        self.show()?;
        Ok(merged)
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<ClusterSums>> {
        self.steps.sums_of(clusters)
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        self.steps.moves_since_merge()
    }
}
