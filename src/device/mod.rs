//! Devices: what can carry out the steps of an algorithm.
//!
//! [`crate::cluster`] holds the drivers of the algorithms and knows only the traits here. Three devices implement them.
//! [`plain`] is the definition of each step as sequential code. `cpu` and `gpu` are the ones in use, and a given
//! sequence of calls gives the same labels and energies, bit for bit, on all three.

pub mod adapter;
pub mod cpu;
pub mod dual_edge;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(not(feature = "gpu"))]
#[path = "no_gpu.rs"]
mod gpu;
pub mod pieces;
pub mod plain;
mod profile;
pub mod select;
pub mod tuning;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use serde::Serialize;
use utoipa::ToSchema;

pub use self::dual_edge::DualEdge;
use self::dual_edge::{Rank, Ties, from_into, mutual};
pub use self::profile::{KernelWork, Profile, StageTime};
use crate::energy::{Energy, Functional, LatticeEnergy, Sums as _};
use crate::error::{Error, Result};
use crate::surface::DualGraph;
use crate::surface::samples::Samples;

/// The label of a face that belongs to no cluster (the paper's "null" cluster, P§5.2).
pub const FREE: u32 = u32::MAX;

/// The first iteration of a boundary phase that is a flood ([`crate::cluster::flat`]); the phase counts them from 1.
pub const FLOOD_FROM: u32 = 256;

/// Returns how many bytes of its own memory a device has allocated; None when it has none, or does not know. Any thread
/// may call it at any time.
pub type MemoryMeter = Arc<dyn Fn() -> Option<u64> + Send + Sync>;

/// The device that ran a job.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct DeviceInfo {
    /// `cpu` or `gpu`.
    pub kind: DeviceKind,
    /// Name of the adapter, or of the processor.
    pub name: String,
    /// `rayon`, `vulkan`, `metal` or `dx12`.
    pub backend: String,
    /// Driver and its version; number of threads on the cpu.
    pub driver: String,
}

/// The two kinds of devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum DeviceKind {
    /// Threads of this machine.
    Cpu,
    /// A graphics processor.
    Gpu,
}

impl DeviceKind {
    /// As it is written in reports, metrics and commands.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// Something that can cluster items by an energy.
pub trait Device<E: Functional = Energy>: Send {
    /// What it is.
    fn info(&self) -> &DeviceInfo;

    /// It, if it is a gpu: for points of other numbers of coordinates.
    fn as_gpu(&mut self) -> Option<&mut gpu::GpuDevice> {
        None
    }

    /// Another device like this one that may work at the same time, where that costs nothing: for small meshes, and for
    /// several starts of one clustering.
    fn another(&self) -> Option<Box<dyn Device<E>>> {
        None
    }

    /// A device for coarse graphs of so many faces, where that costs less than this one; it may work at the same time.
    fn for_start(&self, _faces: usize) -> Option<Box<dyn Device<E>>> {
        self.another()
    }

    /// A device for merges of so many single faces, without moves of faces in between, where this one should not have
    /// memory for a cluster a face. It then has memory for `left` clusters.
    fn for_merges(&self, _faces: u64, _left: u64) -> Option<Box<dyn Device<E>>> {
        None
    }

    /// Tells of its memory.
    fn memory_meter(&self) -> MemoryMeter {
        Arc::new(|| None)
    }

    /// Takes the device time of the work since the last call; none if the device was not opened to be timed, or has no
    /// timestamps.
    fn take_profile(&mut self) -> Result<Option<Profile>> {
        Ok(None)
    }

    /// Bytes a second, read and written, of copies within the device's memory; none without timestamps.
    fn copy_bandwidth(&mut self) -> Result<Option<f64>> {
        Ok(None)
    }

    /// Brings a surface to the device, with all faces free.
    ///
    /// `component_of_cluster[c]` is the component of the surface that cluster `c` lies in: clusters never leave it.
    fn open<'a>(&'a mut self, graph: &'a DualGraph<E>, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        Ok(self.open_merging(graph, component_of_cluster)?)
    }

    /// The same for a hierarchical clustering.
    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps<E> + 'a>>;

    /// Brings the samples of faces to the device; None where the host compares them with shapes.
    fn open_shapes(&mut self, _: &DualGraph<E>, _: &Samples) -> Result<Option<Box<dyn ShapeSteps>>> {
        Ok(None)
    }
}

/// Words of a shape for a device, in the order that `shaders/shapes/shape_propose.wgsl` has them.
pub type ShapeWords = [u32; 16];

/// The step of clusterings by shapes that devices make.
pub trait ShapeSteps: Send {
    /// For each listed face the cluster beside it where it costs least (the smaller number of equal ones), [`FREE`] if
    /// that is not less than in its own. `labels` has one a face, `shapes` one a cluster.
    fn propose(&mut self, labels: &[u32], shapes: &[ShapeWords], listed: &[u32]) -> Result<Vec<u32>>;
}

/// The steps that algorithms are made of, on one surface. Faces are in the surface's internal order.
///
/// Clusters are numbers below that of `component_of_cluster`; one without faces is as good as not there.
pub trait Steps {
    /// Replaces all labels: one a face, a cluster or [`FREE`]. All faces may bid again.
    fn set_labels(&mut self, labels: &[u32]) -> Result<()>;

    /// Replaces all labels by others that leave no face free, as moves of faces: clusters that merged stay merged, and
    /// clusters without faces get none.
    fn relabel(&mut self, labels: &[u32]) -> Result<()>;

    /// Grows the clusters over the free faces, breadth first (P§5.3): in each pass every free face with labelled
    /// neighbours takes the smallest of their labels, all faces at once, until no free face has a labelled neighbour.
    fn grow(&mut self, cancel: &Cancel) -> Result<()>;

    /// Energy of the current labels with respect to the lattice proxies.
    fn energy(&mut self) -> Result<LatticeEnergy>;

    /// Boundary-based optimisation (P§3.2, defined in [`crate::cluster::flat`]) until nothing moves or
    /// `max_iterations` iterations with moves were made. All faces must be labelled.
    ///
    /// `on_step` is called with every iteration in which something moved, in order, though maybe in batches.
    fn optimise_boundary(&mut self, max_iterations: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending>;

    /// Refinement (see [`crate::cluster::refinement`] for the definition) until there are no bids or `max_iterations`
    /// iterations with moves were made; otherwise like [`optimise_boundary`](Self::optimise_boundary).
    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending>;

    /// The next phase goes on with the last one, which stopped at its limit: faces that were refused stay refused, and
    /// iterations are counted on. Call it right before that phase.
    fn resume(&mut self);

    /// Frees the faces outside the piece with the most faces (of equally large ones, that with the smallest face) of
    /// each cluster, and grows the clusters over them, as [`grow`](Self::grow) does. Returns how many that were. All
    /// faces must be labelled.
    fn repair(&mut self, cancel: &Cancel) -> Result<u64>;

    /// The current labels.
    fn labels(&mut self) -> Result<Vec<u32>>;
}

/// The further steps of hierarchical clustering.
pub trait MergeSteps<E: Functional = Energy>: Steps {
    /// The best dual edge (P§5.4) of each cluster that has faces and neighbours, in the order of the clusters.
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>>;

    /// The pairs of clusters that chose each other as ends of their best dual edges, in no particular order.
    fn mutual_dual_edges(&mut self, ties: Ties) -> Result<Vec<Rank<u32>>> {
        Ok(mutual(&self.optimal_dual_edges(ties)?, &mut Vec::new()))
    }

    /// The two ends of the dual edge with the smallest exact cost of all, the smaller number first.
    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>>;

    /// Merges pairs of clusters that have faces, each the first into the second of its pair (`(from, into)`); no
    /// cluster is in two pairs.
    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()>;

    /// Merges pairs of clusters, given with the smaller number first, as [`from_into`] orders them; no cluster is in
    /// two pairs. Returns the ordered pairs, and the sums of both clusters of each before, the smaller number first.
    fn merge_pairs(&mut self, pairs: &[(u32, u32)]) -> Result<(Merges, Vec<E::Sums>)> {
        let ends: Vec<u32> = pairs.iter().flat_map(|&(low, high)| [low, high]).collect();
        let sums = self.sums_of(&ends)?;
        let ordered: Merges = pairs
            .iter()
            .zip(sums.as_chunks().0)
            .map(|(&pair, [low, high])| from_into(pair, [low.faces(), high.faces()]))
            .collect();
        self.merge(&ordered)?;
        Ok((ordered, sums))
    }

    /// The sums of some clusters.
    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<E::Sums>>;

    /// The faces that belong to another cluster than after the last [`merge`](Self::merge), sorted: the face, the
    /// cluster it belonged to and the one it belongs to.
    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>>;
}

/// Merges of clusters: the first of each pair becomes part of the second.
pub type Merges = Vec<(u32, u32)>;

/// What one iteration did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Energy after it.
    pub energy: LatticeEnergy,
    /// Faces that changed their cluster, each once for every pass of the iteration in which it did.
    pub moves: u64,
}

/// Called with the iterations of a phase.
pub type OnStep<'a> = &'a mut dyn FnMut(Step);

/// Why an optimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// No admissible move is left.
    Converged,
    /// The allowed number of iterations was made; there may be moves left.
    IterationLimit,
    /// The same of a bound on work ([`crate::cluster::connected::settle`]).
    WorkLimit,
}

/// A flag that cancels a running job; clones share it.
///
/// A run checks it in every iteration; a watchdog can [count](Self::counting) the checks to see whether the run makes
/// progress.
#[derive(Debug, Clone, Default)]
pub struct Cancel {
    is_cancelled: Arc<AtomicBool>,
    looks: Arc<AtomicU64>,
}

impl Cancel {
    /// The same flag; `looks` counts its checks.
    pub fn counting(&self, looks: Arc<AtomicU64>) -> Self {
        Self { is_cancelled: Arc::clone(&self.is_cancelled), looks }
    }

    /// Cancels the job.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether the job was cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.looks.fetch_add(1, Ordering::Relaxed);
        self.is_cancelled.load(Ordering::Relaxed)
    }

    /// An error if the job was cancelled.
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() { Err(Error::cancelled()) } else { Ok(()) }
    }
}
