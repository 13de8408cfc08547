//! The gpu device: wgpu on Vulkan, Metal and DX12, with the kernels of `shaders/`. `docs/gpu.md` has the dispatches of
//! each step, their bytes, the memory of a surface, and the proof that labels equal those of the cpu.
//!
//! | file | what it has |
//! |---|---|
//! | `adapter`, `choice` | the adapters of the machine, which of them can cluster, and which is meant |
//! | `connection` | an open adapter: queue, pipelines, errors, injected faults; `clock` times its passes |
//! | `kernels` | the table of kernels: a kernel is its WGSL file, a row, and a dispatch |
//! | `axes` | kernels for points of other numbers of coordinates |
//! | `buffers` | the table of storage buffers; `layout` has the structs in them, in Rust and WGSL |
//! | `memory` | a surface on the device: buffers, bind groups, sizes of dispatches; `upload` fills it |
//! | `pages` | buffers beyond the largest binding |
//! | `numbering` | the clusters that the device knows |
//! | `state` | what the host knows about a surface, and how submissions begin; `readback` has how they end |
//! | `batches` | iterations that are queued at once |
//! | `steps`, `merge_steps` | the steps of the algorithms, as lists of kernels |
//! | `shapes` | the step of clusterings by shapes, with a kernel of its own |
//! | `probe` | what dispatches, round trips and transfers cost |
//! | `self_test`, `verify` | whether the device computes as the cpu does: when it opens, when labels come back |
//!
//! The first kernel of an iteration works on *listed* faces: those with a neighbour of another cluster, and free ones;
//! the others on *movers*, which the first has found. Each reads what all threads of the one before wrote. Iterations
//! are queued in batches; the device itself ends a phase.
//!
//! An iteration is the function of the labels that [`crate::cluster::flat`] and [`crate::cluster::refinement`] define,
//! since every number that decides a label is an integer, and no result depends on the order of threads.
//!
//! Everything that wgpu reports becomes an error of the call that notices it ([`Kind::DeviceLost`] for a lost device
//! and for lack of memory), and the next surface gets a new connection. [`GpuDevice::inject`] causes failures for
//! tests.
//!
//! A driver that computes wrongly becomes an error, too: [`Kind::DeviceUnsuitable`] of an adapter that fails its
//! self-test, [`Kind::DeviceWrong`] where labels do not have the energy that the device added up.

pub mod adapter;
mod axes;
mod batches;
pub mod buffers;
mod choice;
mod clock;
mod connection;
pub mod kernels;
pub mod layout;
mod memory;
mod merge_steps;
mod numbering;
pub mod pages;
mod pipeline;
mod probe;
mod readback;
mod self_test;
pub mod shapes;
mod state;
mod steps;
#[cfg(test)]
mod tests;
mod upload;
mod verify;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use self::adapter::Found;
pub use self::axes::MOST_AXES;
use self::buffers::Sizes;
pub use self::choice::{adapters, open, open_hardware, tested_adapters};
use self::connection::Connection;
pub use self::probe::probe;
use self::shapes::GpuShapes;
use self::state::GpuSteps;
use super::adapter::{AdapterKind, AdapterReport};
use super::cpu::CpuDevice;
pub use super::tuning::Tuning;
use super::{Device, DeviceInfo, DeviceKind, MemoryMeter, MergeSteps, Profile, ShapeSteps, Steps};
use crate::energy::{Energy, Words};
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;
use crate::surface::samples::Samples;

/// What a mutex holds, also after a panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Changes to how an adapter is opened: limits that tests lower instead of making meshes that reach them, and
/// timestamps, which cost time.
#[derive(Debug, Clone, Copy, Default)]
pub struct Overrides {
    /// Workgroups in a dimension of a dispatch.
    pub workgroups_per_dimension: Option<u32>,
    /// Bytes of the largest binding.
    pub binding_size: Option<u64>,
    /// Whether buffers have no pages, as where an adapter has no arrays of bindings.
    pub without_pages: bool,
    /// Whether passes are timed and dispatches counted, for [`Device::take_profile`].
    pub timed: bool,
    /// A failure of the self-test.
    pub fault: Option<Fault>,
    /// Constants.
    pub tuning: Tuning,
}

impl Overrides {
    /// Timed, with these constants.
    pub fn timed(tuning: Tuning) -> Self {
        Self { timed: true, tuning, ..Self::default() }
    }
}

/// A failure that a test injects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The device is lost.
    Lose(FaultPoint),
    /// wgpu refuses a call.
    Misuse(FaultPoint),
    /// There is no memory for the next buffer.
    Exhaust(FaultPoint),
    /// The last of the next numbers that the host reads is wrong.
    Miscompute(FaultPoint),
}

impl Fault {
    /// Where it happens.
    fn point(self) -> FaultPoint {
        match self {
            Self::Lose(point) | Self::Misuse(point) | Self::Exhaust(point) | Self::Miscompute(point) => point,
        }
    }
}

/// Where a failure happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultPoint {
    /// Before a surface is uploaded.
    Upload,
    /// Before a batch of the growth is queued.
    Grow,
    /// Before a batch of the boundary phase is queued.
    Boundary,
    /// Before a batch of the refinement is queued.
    Refine,
    /// Before pieces are searched.
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
    /// Opens an adapter. [`Kind::DeviceUnsuitable`] where it cannot cluster, or fails its self-test.
    pub fn new(found: &Found) -> Result<Self> {
        Self::with_overrides(found, Overrides::default())
    }

    /// Opens an adapter as if its limits were lower.
    pub fn with_overrides(found: &Found, overrides: Overrides) -> Result<Self> {
        let report = found.report.clone();
        if let Some(reason) = &report.reason {
            return Err(Error::unsuitable(format_args!("the gpu {} cannot cluster: {reason}", report.name)));
        }
        let connection = connect(found, overrides)?;
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

    /// Makes something fail once, on the next surface that is opened.
    pub fn inject(&mut self, fault: Fault) {
        self.fault = Some(fault);
    }

    /// The connection; a new one if the last broke. The adapter may have gone with the device, so it is looked for
    /// again.
    fn connection(&self) -> Result<Arc<Connection>> {
        let broken = lock(&self.opened).take_if(|connection| connection.check().is_err());
        // dropped outside of the lock, which a memory meter may be waiting for
        drop(broken);
        if let Some(connection) = lock(&self.opened).as_ref() {
            return Ok(Arc::clone(connection));
        }
        let adapters = adapter::enumerate();
        // numbers change when others came or went
        let is_same = |AdapterReport { name, backend, usable, .. }: &AdapterReport| {
            *usable && (name, backend) == (&self.report.name, &self.report.backend)
        };
        let found = adapters
            .iter()
            .find(|found| found.report == self.report)
            .or_else(|| adapters.iter().find(|found| is_same(&found.report)))
            .ok_or_else(|| Error::new(Kind::DeviceLost, format_args!("the gpu is gone: {}", self.report.name)))?;
        tracing::warn!(adapter = self.report.name, "opening the lost gpu again");
        let connection = connect(found, self.overrides)?;
        *lock(&self.opened) = Some(Arc::clone(&connection));
        Ok(connection)
    }

    fn steps<'a, E: Words>(
        &mut self,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
        is_merging: bool,
    ) -> Result<GpuSteps<'a, E>> {
        let fault = self.fault.take();
        let connection = self.connection()?;
        prepare::<E>(&connection, false)?;
        connection.arm(fault);
        GpuSteps::new(connection, graph, component_of_cluster, is_merging, false)
    }
}

/// Opens an adapter and tests it.
fn connect(found: &Found, overrides: Overrides) -> Result<Arc<Connection>> {
    let connection = Arc::new(Connection::open(found, overrides)?);
    prepare::<Energy>(&connection, false)?;
    Ok(connection)
}

/// Compiles and tests the kernels for points of an energy, once; with `is_paged`, for buffers in pages.
/// [`Kind::DeviceUnsuitable`] where they fail the test, and for more than [`MOST_AXES`].
fn prepare<E: Words>(connection: &Arc<Connection>, is_paged: bool) -> Result<()> {
    if let Some(outcome) = lock(&connection.tested).get(&(E::AXES, is_paged)) {
        return outcome.clone();
    }
    if E::AXES > MOST_AXES {
        let message =
            format_args!("a gpu takes points of at most {MOST_AXES} coordinates, use the cpu device: {}", E::AXES);
        return Err(Error::unsuitable(message));
    }
    connection.compile(E::AXES, is_paged)?;
    let outcome = self_test::run::<E>(connection, is_paged);
    lock(&connection.tested).insert((E::AXES, is_paged), outcome.clone());
    outcome
}

impl Drop for GpuDevice {
    fn drop(&mut self) {
        // a memory meter may outlive the device
        *lock(&self.opened) = None;
    }
}

impl<E: Words> Device<E> for GpuDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn as_gpu(&mut self) -> Option<&mut GpuDevice> {
        Some(self)
    }

    fn for_start(&self, faces: usize) -> Option<Box<dyn Device<E>>> {
        let more = if self.report.kind == AdapterKind::Software { 4 } else { 1 };
        let most = more * self.overrides.tuning.start_on_cpu as usize;
        (faces <= most).then(|| Box::new(CpuDevice::new()) as Box<dyn Device<E>>)
    }

    fn for_merges(&self, faces: u64, left: u64) -> Option<Box<dyn Device<E>>> {
        let bindings = self.connection().ok()?.bindings;
        let fit = |clusters| bindings.hold(&kernels::needed(true), &Sizes::of(E::AXES, faces, clusters));
        let are_many = faces > self.overrides.tuning.merges_up_to.into() || !fit(faces);
        // what does not fit afterwards is better refused before
        (are_many && fit(left)).then(|| Box::new(CpuDevice::new()) as Box<dyn Device<E>>)
    }

    fn memory_meter(&self) -> MemoryMeter {
        let opened = Arc::clone(&self.opened);
        Arc::new(move || {
            let connection = lock(&opened).clone();
            Some(connection?.device.generate_allocator_report()?.total_reserved_bytes)
        })
    }

    fn take_profile(&mut self) -> Result<Option<Profile>> {
        self.connection()?.take_profile()
    }

    fn copy_bandwidth(&mut self) -> Result<Option<f64>> {
        let connection = self.connection()?;
        // of buffers of at most 256 MiB
        connection.copy_bandwidth(connection.limits.max_buffer_size.min(1 << 28))
    }

    fn open<'a>(&'a mut self, graph: &'a DualGraph<E>, component_of_cluster: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
        Ok(Box::new(self.steps(graph, component_of_cluster, false)?))
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
    ) -> Result<Box<dyn MergeSteps<E> + 'a>> {
        Ok(Box::new(self.steps(graph, component_of_cluster, true)?))
    }

    fn open_shapes(&mut self, graph: &DualGraph<E>, samples: &Samples) -> Result<Option<Box<dyn ShapeSteps>>> {
        let fault = self.fault.take();
        let connection = self.connection()?;
        connection.arm(fault);
        Ok(Some(Box::new(GpuShapes::new(connection, graph, samples)?)))
    }
}
