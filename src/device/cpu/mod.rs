//! The cpu device: the steps of an algorithm on the threads of this machine.
//!
//! # Reading order
//!
//! [`steps`] has the public interface and the state that it works on. [`listed`] is the state in which faces move: it
//! applies moves and merges to a [`Partition`]. One boundary iteration is [`boundary::BoundaryPhase::moves`], one of
//! refinement [`refine::RefinementPhase::moves`]; both read as their definitions in [`crate::cluster::flat`] and
//! [`crate::cluster::refinement`], except that they evaluate only [`active_faces`]. [`best_edge`] finds what to merge,
//! [`pieces`] what was cut off, [`grow`] labels free faces.
//!
//! # Invariants
//!
//! * Labels and energies after every iteration equal those of [`super::plain`], for any number of threads.
//! * All threads evaluate faces; moves and merges are applied by one thread, because they are few.
//! * [`tuning`] and [`crate::prefetch`] change how long a step takes, and no result. On large meshes most of that is
//!   waiting for memory.

mod active_faces;
mod best_edge;
mod bids;
mod boundary;
mod boundary_faces;
mod change_log;
pub(super) mod clusters;
mod grow;
mod labels;
mod listed;
mod nearby;
mod pieces;
mod refine;
mod steps;
mod tuning;

use rayon::current_num_threads;

use super::{Device, MergeSteps};
use crate::device::{DeviceInfo, DeviceKind};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::DualGraph;
use boundary_faces::BoundaryFaces;
use clusters::Clusters;
use labels::Labels;
use steps::CpuSteps;

/// The threads of this machine, through rayon's pool: the one that it is called in, else the global one.
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

    /// What it is, whatever the energy.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }
}

impl Default for CpuDevice {
    fn default() -> Self {
        Self::new()
    }
}

impl<E: Functional> Device<E> for CpuDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn another(&self) -> Option<Box<dyn Device<E>>> {
        Some(Box::new(Self { info: self.info.clone() }))
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps<E> + 'a>> {
        Ok(Box::new(CpuSteps::new(graph, component_of_cluster)))
    }
}

/// A face that moves from one cluster to another.
#[derive(Debug, Clone, Copy)]
struct Move {
    face: u32,
    from: u32,
    to: u32,
}

/// A graph whose faces are all labelled, and what is kept in step with the labels.
#[derive(Debug)]
struct Partition<'a, E: Functional> {
    graph: &'a DualGraph<E>,
    labels: Labels,
    clusters: Clusters<E>,
    boundary: BoundaryFaces,
}

#[cfg(test)]
mod tests;
