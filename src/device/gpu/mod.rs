//! The gpu device: wgpu on Vulkan, Metal and DX12, with the kernels of `shaders/`.
//!
//! # Why the labels equal the cpu's
//!
//! Every number that decides a label is an integer, and WGSL specifies integers exactly. Threads influence each other only
//! through sums, extremes and counts, which do not depend on an order; a kernel reads none of those that it writes itself,
//! with the exception of the carry, which `shaders/shared/add.wgsl` explains, of the trees of faces that become pieces,
//! which end the same in whatever order they are hooked together (`shaders/pieces/piece_union.wgsl`), of gaps, at which the later of two pieces
//! finds the earlier (`shaders/doubt.wgsl`), and of labels that are brought up to date, to the same by all who do. Ties go to the
//! smaller cluster or face. So an iteration is a function of the labels before it, the one that [`crate::cluster`] defines, on
//! every device. (A refusal in the refinement is remembered as the turn in which it happened, and stands until a cluster
//! around the face has changed in that turn or later; the cpu keeps a list instead, which says the same.)
//!
//! # What runs
//!
//! Faces decide on boundaries, so that is where threads are: a list has every face with a neighbour of another cluster, and
//! every free one. A face that moves lists its neighbours, unless they are listed; `boundary_compact` takes off those whose boundary has
//! gone, before each batch of a flat clustering and once in each round of a hierarchy. The clusters that are left are listed, too, by
//! the host, which knows which ones merge. In the table a *listed face* and a *cluster* is one of those.
//!
//! In a hierarchy clusters begin *small*, with most faces listed, and end *large*: with 64 faces each or more. Then a merge tells
//! the listed faces and those beside them only; others keep the label of a cluster that has ended until somebody needs it
//! (`shaders/shared/merged.wgsl`): a face that comes to be listed brings those around it up to date, and before all are
//! read, all are. Pieces are then looked for *near* what moved, if that is one face in 64 or less (`pieces.rs`).
//!
//! | step | dispatches |
//! |---|---|
//! | sums and lists from labels | 3: `sums_gather` (a thread for 8 faces), `boundary_build` (a thread a face), `boundary_publish` (one thread) |
//! | a pass of the growth | 2: `growth_propose` (a thread a listed face, between two arrays of labels), `growth_check_done` (one thread) |
//! | before a phase | 1: `proxies_fit` (a thread a cluster) |
//! | before a batch of a flat clustering | 2: `boundary_compact` (a thread a listed face), `boundary_publish` (one thread) |
//! | an iteration of the boundary phase | 3: `boundary_propose`, `boundary_apply` (a thread a listed face), `proxies_fit` (a thread a cluster) |
//! | an iteration of the refinement | 5: `face_bid`, `select_bids`, `join_moves` (a thread a listed face), `evaluate_moves` (a thread a cluster), `commit_moves` (a thread a listed face) |
//! | pieces | 7: `proxies_fit`, `piece_link`, `piece_union` (a thread a face), `piece_size` (a thread for 8 faces), `piece_select_largest`, `piece_detach` (a thread a face), `growth_check_done` (one thread); before, once labels are not up to date, `follow` (a thread a face) |
//! | pieces near what moved | 20: `proxies_fit`, `explore`, `growth_check_done`, `piece_link`, `piece_union`, `piece_size`, `tally`, `mark_gaps`, `piece_union`, `doubt` (a thread a listed face), `decide` (a thread a cluster), `follow`, `piece_link`, `piece_union`, `piece_size`, which have no workgroups unless there are doubts, `piece_select_largest`, `piece_detach`, `growth_check_done`, `boundary_compact`, `boundary_publish` |
//! | before a growth after merges | 1: `mirror` (a thread a listed face), once labels are not up to date |
//! | optimal dual edges | 7: `proxies_fit`, `boundary_compact`, `boundary_publish`, `min_dual_edge_cost`, `min_dual_edge_tie`, `min_dual_edge_other` (a thread a listed face), `dual_edges_publish` (a thread a cluster) |
//! | the cheapest dual edge | 5: `proxies_fit`, `boundary_compact`, `boundary_publish`, `cheapest_dual_edge` (a thread a listed face, one candidate a workgroup), `cheapest_dual_edge_reduce` (one workgroup) |
//! | a merge | 3: `growth_check_done`, `merge_apply` (a thread a pair), and `merge_relabel` (a thread a face) while clusters are small, `relabel_near` (a thread a listed face) when they are large |
//! | sums of some clusters | 1 for 2¹⁸ of them: `sums_copy` (a thread each) |
//! | faces that moved since a merge | 2: `growth_check_done` (one thread), `moves_list` (a thread a listed face) |
//!
//! Those with a thread a listed face are dispatched indirectly, over as many as there are: `proxies_fit` and `evaluate_moves` count them in each
//! turn. When there is nothing left to do, they or `growth_check_done` set the number of workgroups of all that is still queued to zero;
//! what is left then is `growth_check_done`'s one thread, or `proxies_fit` and `evaluate_moves` looking at one number.
//!
//! Each dispatch of an iteration reads what all threads of the one before it wrote, so that there cannot be fewer.
//! Faces that come to a boundary are listed by `boundary_apply` itself, and by `join_moves` before it is known whether they will, so that
//! counting them takes none.
//!
//! # What it costs
//!
//! Bytes that kernels read and write, counted from their text for a closed triangle mesh, every read of a neighbour's label and
//! of a proxy on its own; what is cached is less. A face that sees one other cluster, and does not move:
//!
//! | step | for each listed face | cluster | face of the mesh |
//! |---|---|---|---|
//! | an iteration of the boundary phase | 100 | 68 | |
//! | an iteration of the refinement | 152, and 60 if it bids | 16 | |
//! | `boundary_compact` | 44 | | |
//! | optimal dual edges, with `boundary_compact` | 344 | 120 | |
//! | a merge of small clusters | | | 12, and 4 if it is listed, 4 if its cluster ends |
//! | a merge of large ones | 60 | | |
//! | pieces | | 84 | 28 where its cluster is known to be whole, else some 140 |
//! | pieces near what moved | 330, and up to 64 faces around each that moved are listed for it | 88 | |
//! | a pass of the growth | 12, and 32 if it is free | | |
//! | sums and lists from labels | | 48 | 64 |
//!
//! So an iteration costs in proportion to the boundaries and to the clusters that are left, and so do the rounds of a hierarchy
//! of large clusters, unless more than one face in 64 has moved. On the bunny, 69,451 faces, that many do move in most rounds with
//! fewer than 1,000 clusters (2,100 in the one that leaves 16), while nine in ten clusters lose a face: pieces are looked for among
//! all faces there until a handful are left. As boundaries grow with the root of the number of faces, larger meshes come to it
//! earlier. The sequential kind has a round a face, each over all listed faces; the cpu device, which looks only at what changed, is
//! the one for it. A software gpu refuses it above 2²⁴ faces times clusters.
//!
//! Where the ring has told of no moves, the host asks for none, nor for pieces.
//!
//! When a surface is opened, what never changes of it goes to the device: 20 bytes a face and 4 for each neighbour, 32 a face of a
//! closed triangle mesh, and 20 for each cluster. In a service another thread brings the former while the device works on the
//! job before (`ahead.rs`): so the memory of the device holds that much more, for two meshes while the job at the device is at
//! coarser surfaces than its own, and pieces of up to 16 MiB on their way. Nothing is transferred to make faces free. A start's
//! labels follow, 4 bytes a face. On llvmpipe, where all of this is done by the processors that do the device's work, jobs of
//! igea take as long with as without; no card was at hand.
//!
//! Within a growth or a phase only the ring comes back: 2 KiB for a batch of up to 64 turns, while the next one runs. Between them
//! the labels do after the first growth, and where pieces that were cut off are looked for, the number of their faces, with a
//! ring. A hierarchy reads besides, in each round, 12 bytes for each cluster that is left and for each face that moved (for 4096 of
//! them at least), and 36 for each that merges; for the cheapest dual edge 64 bytes. It writes 4 bytes for each cluster that is
//! left and 8 for each merge.
//!
//! On a software gpu (llvmpipe, two busy cores) a hierarchy of the bunny, 69,451 faces, takes 8.3 s of processor time to the top with all rounds optimised; it
//! took 16.9 s while all faces and all clusters that there ever were had a thread in every step, and the host looked for
//! pieces. 1,000 clusters of it take 2.2 s from seeds and 1.7 s from a coarse start, then 3.1 s and 2.6 s. That merges tell only
//! listed faces, and that pieces are looked for near moves, makes no difference to a whole hierarchy there, nor to that of igea
//! (268,686 faces, 43 s): early rounds decide.
//!
//! Left out: summing up what the threads of a workgroup bring to one cluster before it goes to memory that all share. On
//! llvmpipe that makes 3 clusters of the bunny 28 % slower and 1,000 clusters 11 %; whether it pays where few clusters are
//! contended for is for a graphics processor to say.
//!
//! # Memory on the device
//!
//! | for each | bytes |
//! |---|---|
//! | face | 52 and 4 for each neighbour, so 64 in a closed triangle mesh: centroid and weight 16, neighbours 4 + 12, label 4, wish 4, offer 12 (where pieces are looked for, wish and offer are their trees and sizes), origin 4, two lists 8 |
//! | cluster | 148: sums 48, sums of those that join 48, proxy and energy shift 16, bidding 32, list 4 |
//! | face of a hierarchy | 12 more: list of findings |
//! | cluster of a hierarchy | 20 more: choice 12, merged cluster 4, list of the host 4 |
//! | surface | 23 KiB: the ring, its two copies for the host, 65 turns; in a hierarchy up to 9 MiB more for sums that the host reads |
//! | face, in memory that the host reads | 4 for its label; 12 in a hierarchy, for the longest list |
//!
//! The largest buffers are the faces and the neighbours with 16 bytes a face each: the smallest binding that a
//! portable device offers, 128 MiB, holds 8 million faces. A hierarchy starts with a cluster a face, which makes 244 bytes a
//! face in a closed triangle mesh, the largest of its buffers 48: that binding holds 2.7 million faces. What does not fit is
//! refused.
//!
//! Buffers stay for the next surfaces, which take those that have room for them and not more than twice as much as they need: 256
//! MiB at most, and those that one of the last 32 surfaces used (`pool.rs`); nothing where a surface did not fit, and once the
//! device [rests](Device::rest). A surface that is brought ahead of its turn is given up where there is no room for it, or for the
//! one that is opened before it: that one is tried again once all that is kept has been freed.
//!
//! # Compiled kernels
//!
//! The driver compiles the kernels when a connection is opened (those of hierarchies when the first is asked for), and Mesa's
//! and NVIDIA's keep what they compiled on disk, in `$XDG_CACHE_HOME` or `~/.cache`, for the next process. On llvmpipe that
//! takes the command line on a mesh of 300 faces from 2.4 s of processor time to 0.4 s. `deploy/` names a folder that can be
//! written and stays. wgpu's own pipeline cache, for which the caller vouches (`unsafe`), would keep the same a second time.
//!
//! # When something fails
//!
//! Everything that wgpu reports becomes an error of the call that notices ([`Kind::DeviceLost`] for a lost device and for
//! memory that ran out), and the next surface gets a new connection. [`GpuDevice::inject`] makes it happen.

pub mod adapter;
mod buffers;
mod clock;
mod connection;
mod fixed;
pub mod kernels;
pub mod layout;
#[cfg(test)]
mod list_tests;
mod merge_steps;
mod merging;
mod pieces;
mod readback;
mod steps;

use std::sync::{Arc, Mutex};

use self::adapter::{AdapterKind, AdapterReport, Found};
use self::buffers::Buffers;
pub use self::clock::{Profile, StageTime};
use self::connection::{Connection, lock};
use self::merging::Merging;
use self::steps::GpuSteps;
use super::{Device, MemoryMeter, MergeSteps, Steps};
use crate::error::{Error, Kind, Result};
use crate::report::{DeviceInfo, DeviceKind};
use crate::surface::DualGraph;

/// How an adapter is opened otherwise than usual: limits that tests lower, instead of making meshes that reach them, and
/// timestamps, which are not free.
#[derive(Debug, Clone, Copy, Default)]
pub struct Overrides {
    /// Workgroups in a dimension of a dispatch.
    pub workgroups_per_dimension: Option<u32>,
    /// Bytes that a kernel sees of a buffer.
    pub binding_size: Option<u64>,
    /// Whether passes are timed and dispatches counted, for [`GpuDevice::take_profile`].
    pub timed: bool,
}

/// Bytes a face of a closed triangle mesh that a sweep over the mesh, sums and lists from labels, reads and writes: those in the
/// table above, but for the labels of neighbours and the second reading of where a row begins, which come from the caches.
pub const SWEEP_BYTES_A_FACE: u64 = 48;

/// A failure that a test asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The device is lost.
    Lose(FaultPoint),
    /// wgpu refuses a call.
    Misuse(FaultPoint),
    /// There is no memory for the next buffer.
    Exhaust(FaultPoint),
}

impl Fault {
    /// Where it happens.
    fn point(self) -> FaultPoint {
        match self {
            Self::Lose(point) | Self::Misuse(point) | Self::Exhaust(point) => point,
        }
    }
}

/// Where it happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultPoint {
    /// Before a surface is brought to the device, when it is opened.
    Upload,
    /// Before a batch of the growth is queued.
    Grow,
    /// Before a batch of the boundary phase is queued.
    Boundary,
    /// Before a batch of the refinement is queued.
    Refine,
    /// Before pieces are looked for.
    Pieces,
    /// Before the labels are read.
    Labels,
    /// Before dual edges are searched.
    DualEdges,
    /// Before clusters merge.
    Merge,
}

/// A graphics processor.
#[derive(Debug)]
pub struct GpuDevice {
    report: AdapterReport,
    info: DeviceInfo,
    overrides: Overrides,
    /// None after it broke. Shared with [`Device::memory_meter`].
    opened: Arc<Mutex<Option<Arc<Connection>>>>,
    fault: Option<Fault>,
}

impl GpuDevice {
    /// Opens an adapter.
    pub fn new(found: &Found) -> Result<Self> {
        Self::with_overrides(found, Overrides::default())
    }

    /// Opens an adapter as if its limits were lower.
    pub fn with_overrides(found: &Found, overrides: Overrides) -> Result<Self> {
        let report = found.report.clone();
        if let Some(reason) = &report.reason {
            return Err(Error::new(
                Kind::DeviceUnsuitable,
                format_args!("the gpu {} cannot cluster: {reason}", report.name),
            ));
        }
        let connection = Arc::new(Connection::open(found, overrides)?);
        Ok(Self {
            info: DeviceInfo {
                kind: DeviceKind::Gpu,
                name: report.name.clone(),
                backend: report.backend.clone(),
                driver: report.driver.clone(),
            },
            report,
            overrides,
            opened: Arc::new(Mutex::new(Some(connection))),
            fault: None,
        })
    }

    /// What was done since this was asked last; none where the device was not opened `timed`, or has no timestamps.
    pub fn take_profile(&mut self) -> Result<Option<Profile>> {
        self.connection()?.take_profile()
    }

    /// Bytes a second, those read and those written, of copies within the device's memory, of buffers of 256 MiB where they
    /// can be as large; none where there are no timestamps.
    pub fn copy_bandwidth(&mut self) -> Result<Option<f64>> {
        let connection = self.connection()?;
        connection.copy_bandwidth(connection.limits.max_buffer_size.min(1 << 28))
    }

    /// Makes something fail once, on the next surface that is opened.
    pub fn inject(&mut self, fault: Fault) {
        self.fault = Some(fault);
    }

    /// Whether an adapter that was found anew is this one, though others came or went.
    fn is_same(&self, report: &AdapterReport) -> bool {
        (&report.name, &report.backend, report.usable) == (&self.report.name, &self.report.backend, true)
    }

    /// The connection; a new one if the last broke. The adapter may have gone with the device, so it is looked for again.
    fn connection(&self) -> Result<Arc<Connection>> {
        let mut opened = lock(&self.opened);
        if let Some(connection) = opened.as_ref().filter(|connection| !connection.is_broken()) {
            return Ok(Arc::clone(connection));
        }
        *opened = None;
        let adapters = adapter::enumerate();
        let found = adapters
            .iter()
            .find(|found| found.report == self.report)
            .or_else(|| adapters.iter().find(|found| self.is_same(&found.report)))
            .ok_or_else(|| Error::new(Kind::DeviceLost, format_args!("the gpu is gone: {}", self.report.name)))?;
        tracing::warn!(adapter = self.report.name, "opening the lost gpu again");
        Ok(Arc::clone(opened.insert(Arc::new(Connection::open(found, self.overrides)?))))
    }
}

impl Drop for GpuDevice {
    fn drop(&mut self) {
        // a memory meter may outlive the device
        *lock(&self.opened) = None;
    }
}

impl Device for GpuDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn memory_meter(&self) -> MemoryMeter {
        let opened = Arc::clone(&self.opened);
        Arc::new(move || {
            let connection = lock(&opened).clone();
            Some(connection?.device.generate_allocator_report()?.total_reserved_bytes)
        })
    }

    fn open<'a>(&'a mut self, graph: &'a DualGraph, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        let energy_shifts = energy_shifts(graph, component_of_cluster)?;
        let connection = self.connection()?;
        connection.arm(self.fault.take());
        let buffers = Buffers::new(&connection, graph, &energy_shifts)?;
        Ok(Box::new(GpuSteps::new(connection, graph, component_of_cluster, buffers, None)))
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps + 'a>> {
        let energy_shifts = energy_shifts(graph, component_of_cluster)?;
        let is_software = self.report.kind == AdapterKind::Software;
        let connection = self.connection()?;
        connection.arm(self.fault.take());
        let buffers = Buffers::new(&connection, graph, &energy_shifts)?;
        let merging = Merging::new(&connection, &buffers, energy_shifts.len() as u32, is_software)?;
        Ok(Box::new(GpuSteps::new(connection, graph, component_of_cluster, buffers, Some(merging))))
    }
}

/// The shift of each cluster's energy. An error when the surface contradicts itself or has no faces or clusters.
fn energy_shifts(graph: &DualGraph, component_of_cluster: &[u32]) -> Result<Vec<u32>> {
    let faces = graph.centroids.len();
    let defect = |what: &str| Error::new(Kind::Internal, what);
    if faces == 0 || component_of_cluster.is_empty() {
        return Err(defect("there is nothing to cluster"));
    }
    if component_of_cluster.len() > faces {
        return Err(defect("there are more clusters than faces"));
    }
    if graph.weights.len() != faces
        || graph.neighbour_offsets.len() != faces + 1
        || graph.neighbour_offsets[faces] as usize != graph.neighbours.len()
    {
        return Err(defect("the arrays of the graph differ in length"));
    }
    component_of_cluster
        .iter()
        .map(|&component| match graph.components.get(component as usize) {
            Some(component) if component.energy_shift <= 30 => Ok(component.energy_shift),
            Some(_) => Err(defect("a component's energy shift is above 30")),
            None => Err(defect("a cluster lies in a component that does not exist")),
        })
        .collect()
}
