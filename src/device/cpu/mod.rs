//! The cpu device: the steps of an algorithm on the threads of this machine.
//!
//! It looks only at faces whose decision can have changed. A face decides by its own and its neighbours' clusters, so
//! it needs another look only when one of those gained or lost a face in the last iteration; everything else would
//! decide as before, which was to stay. That makes the labels of every iteration equal to those of a plain sweep.
//! The faces that can ever move lie on boundaries, and those are kept in a list that only grows where faces move.

mod boundary;
mod clusters;
mod grow;

use rayon::current_num_threads;

use super::{Cancel, Device, Ending, LatticeEnergy, Step, Steps};
use crate::error::Result;
use crate::report::{DeviceInfo, DeviceKind};
use crate::surface::Surface;
use boundary::Boundary;
use clusters::Clusters;

/// The threads of this machine, through rayon's global pool.
#[derive(Debug)]
pub struct CpuDevice {
    info: DeviceInfo,
}

impl CpuDevice {
    /// The device; there is always one.
    pub fn new() -> Self {
        let info = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: std::env::consts::ARCH.to_owned(),
            backend: "rayon".to_owned(),
            driver: format!("{} threads", current_num_threads()),
        };
        Self { info }
    }
}

impl Default for CpuDevice {
    fn default() -> Self {
        Self::new()
    }
}

impl Device for CpuDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn open<'a>(
        &'a mut self,
        surface: &'a Surface,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn Steps + 'a>> {
        Ok(Box::new(CpuSteps {
            surface,
            labels: vec![super::FREE; surface.faces()],
            clusters: Clusters::new(surface, component_of_cluster),
            boundary: Boundary::default(),
        }))
    }
}

/// State of one clustering.
struct CpuSteps<'a> {
    surface: &'a Surface,
    /// One a face, internal order.
    labels: Vec<u32>,
    /// Sums and proxies that fit `labels`, or are marked as stale.
    clusters: Clusters,
    boundary: Boundary,
}

impl Steps for CpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.labels.copy_from_slice(labels);
        self.clusters.forget();
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        grow::grow(self.surface, &mut self.labels, cancel)?;
        self.clusters.forget();
        Ok(())
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        self.clusters.gather(self.surface, &self.labels);
        Ok(self.clusters.energy())
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        self.clusters.gather(self.surface, &self.labels);
        self.boundary.collect(self.surface, &self.labels);
        for _ in 0..max_iterations {
            cancel.check()?;
            let moves = self
                .boundary
                .iterate(self.surface, &mut self.labels, &mut self.clusters);
            if moves == 0 {
                return Ok(Ending::Converged);
            }
            on_iteration(Step {
                energy: self.clusters.energy(),
                moves,
            });
        }
        Ok(Ending::IterationLimit)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        Ok(self.labels.clone())
    }
}
