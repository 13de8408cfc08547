//! The cpu device: the steps of an algorithm on the threads of this machine.
//!
//! It looks only at faces whose decision can have changed ([`frontier`]), which makes the labels of every iteration equal
//! to those of a plain sweep. Faces decide in parallel; what they decided is applied in one thread, because it is little.

mod boundary;
mod clusters;
mod frontier;
mod grow;
mod refine;

use rayon::current_num_threads;

use super::{Cancel, Device, Ending, LatticeEnergy, Step, Steps};
use crate::error::Result;
use crate::report::{DeviceInfo, DeviceKind};
use crate::surface::Surface;
use boundary::Leaving;
use clusters::Clusters;
use frontier::Frontier;
use refine::Bids;

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

    fn open<'a>(&'a mut self, surface: &'a Surface, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        Ok(Box::new(CpuSteps {
            surface,
            labels: vec![super::FREE; surface.faces()],
            clusters: Clusters::new(surface, component_of_cluster),
            is_gathered: false,
            frontier: None,
        }))
    }
}

/// Faces a thread takes at a time.
const CHUNK: usize = 1024;

/// A face that wants to leave its cluster.
#[derive(Debug, Clone, Copy)]
struct Move {
    face: u32,
    from: u32,
    to: u32,
}

/// State of one clustering.
struct CpuSteps<'a> {
    surface: &'a Surface,
    /// One a face, internal order.
    labels: Vec<u32>,
    clusters: Clusters,
    /// Whether the sums of `clusters` are those of `labels`.
    is_gathered: bool,
    /// The frontier of `labels`, once an optimisation has needed it.
    frontier: Option<Frontier>,
}

impl CpuSteps<'_> {
    /// Labels were changed from outside.
    fn forget(&mut self) {
        self.is_gathered = false;
        self.frontier = None;
    }

    fn gather(&mut self) {
        if !std::mem::replace(&mut self.is_gathered, true) {
            self.clusters.gather(self.surface, &self.labels);
        }
    }

    /// Carries out iterations until one says that there is nothing left to do (None).
    fn optimise(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
        mut iterate: impl FnMut(&Surface, &mut [u32], &mut Clusters, &mut Frontier) -> Option<u64>,
    ) -> Result<Ending> {
        self.gather();
        self.clusters.mark_all_changed();
        let mut frontier =
            self.frontier.take().unwrap_or_else(|| Frontier::collect(self.surface, &self.labels, self.clusters.len()));
        let mut left = max_iterations;
        let ending = loop {
            cancel.check()?;
            if left == 0 {
                break Ending::IterationLimit;
            }
            match iterate(self.surface, &mut self.labels, &mut self.clusters, &mut frontier) {
                None => break Ending::Converged,
                Some(0) => {}
                Some(moves) => {
                    left -= 1;
                    on_iteration(Step { energy: self.clusters.energy(), moves });
                }
            }
        };
        self.frontier = Some(frontier);
        Ok(ending)
    }
}

impl Steps for CpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.labels.copy_from_slice(labels);
        self.forget();
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        self.forget();
        grow::grow(self.surface, &mut self.labels, cancel)
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        self.gather();
        Ok(self.clusters.energy())
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let mut leaving = Leaving::new(self.clusters.len());
        self.optimise(max_iterations, cancel, on_iteration, |surface, labels, clusters, frontier| {
            // what nothing moves in is the end: a face that was kept back comes with others that moved
            Some(boundary::iterate(surface, labels, clusters, frontier, &mut leaving)).filter(|&moves| moves > 0)
        })
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_iteration: &mut dyn FnMut(Step)) -> Result<Ending> {
        let mut bids = Bids::new(self.clusters.len());
        self.optimise(max_iterations, cancel, on_iteration, |surface, labels, clusters, frontier| {
            bids.iterate(surface, labels, clusters, frontier)
        })
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        Ok(self.labels.clone())
    }
}
