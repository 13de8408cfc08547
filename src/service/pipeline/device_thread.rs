//! The one thread that works with the device: it takes prepared meshes one after the other.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{mpsc, oneshot};

use super::caught;
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device};
use crate::error::{Error, Kind, Result};
use crate::job::{self, Outcome, Prepared};
use crate::report::{DeviceKind, Row};
use crate::service::metrics::Metrics;

/// A mesh to be clustered.
pub(super) struct Task {
    /// The mesh.
    pub prepared: Prepared,
    /// Asks to stop.
    pub cancel: Cancel,
    /// Is told of every row of the report.
    pub on_row: Box<dyn FnMut(Row) + Send>,
    /// Where the lines of the log belong.
    pub span: tracing::Span,
    /// Takes the result; nobody may be waiting any more.
    pub reply: oneshot::Sender<Result<Outcome>>,
    /// Freed when the mesh is: other meshes wait for its place in memory.
    pub slot: super::stages::Slot,
}

/// The way to the thread. It ends when this is dropped.
pub(in crate::service) struct DeviceThread {
    tasks: mpsc::Sender<Task>,
}

impl fmt::Debug for DeviceThread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DeviceThread").finish_non_exhaustive()
    }
}

impl DeviceThread {
    /// Starts the thread. With `or_cpu` the cpu does what the device cannot, or is slow at.
    pub fn start(device: Box<dyn Device>, or_cpu: bool, metrics: Arc<Metrics>) -> Result<Self> {
        let mut devices =
            Devices { cpu: (or_cpu && device.info().kind == DeviceKind::Gpu).then(CpuDevice::new), device };
        let (tasks, mut queue) = mpsc::channel::<Task>(1);
        std::thread::Builder::new()
            .name("device".to_owned())
            .spawn(move || {
                while let Some(task) = queue.blocking_recv() {
                    let started = Instant::now();
                    task.run(&mut devices);
                    metrics.device_worked(started.elapsed());
                }
            })
            .map_err(|error| Error::io("the thread of the device cannot be started", error))?;
        Ok(Self { tasks })
    }

    /// Hands over a mesh, as soon as the thread has room for it.
    pub(super) async fn submit(&self, task: Task) -> Result<()> {
        self.tasks.send(task).await.map_err(|_| Error::new(Kind::Internal, "the thread of the device is gone"))
    }
}

/// What the thread works with.
struct Devices {
    device: Box<dyn Device>,
    /// For what the device cannot do.
    cpu: Option<CpuDevice>,
}

impl Devices {
    fn run(&mut self, prepared: &Prepared, cancel: &Cancel, on_row: &mut dyn FnMut(Row)) -> Result<Outcome> {
        let Some(cpu) = &mut self.cpu else {
            return job::run(prepared, self.device.as_mut(), cancel, on_row);
        };
        if prepared.parameters.algorithm.is_sequential() {
            return job::run(prepared, cpu, cancel, on_row);
        }
        match job::run(prepared, self.device.as_mut(), cancel, on_row) {
            Err(error) if error.kind == Kind::DeviceUnsuitable => {
                tracing::warn!(%error, "taking the cpu instead of the gpu");
                job::run(prepared, cpu, cancel, on_row)
            }
            outcome => outcome,
        }
    }
}

impl Task {
    fn run(self, devices: &mut Devices) {
        let Task { prepared, cancel, mut on_row, span, reply, slot } = self;
        let outcome = {
            let _entered = span.enter();
            caught(|| devices.run(&prepared, &cancel, &mut *on_row))
        };
        // All of the job's rows are told before its outcome.
        drop(on_row);
        drop(prepared);
        drop(slot);
        let _ = reply.send(outcome);
    }
}
