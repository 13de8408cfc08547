//! The one thread that works with the device: it takes prepared meshes one after the other.

use std::fmt;

use tokio::sync::{mpsc, oneshot};

use super::caught;
use crate::device::{Cancel, Device};
use crate::error::{Error, Kind, Result};
use crate::job::{self, Outcome, Prepared};
use crate::report::Iteration;

/// A mesh to be clustered.
pub(super) struct Task {
    /// The mesh.
    pub prepared: Prepared,
    /// Asks to stop.
    pub cancel: Cancel,
    /// Is told of every iteration.
    pub on_iteration: Box<dyn FnMut(&Iteration) + Send>,
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
    /// Starts the thread.
    pub fn start(mut device: Box<dyn Device>) -> Result<Self> {
        let (tasks, mut queue) = mpsc::channel::<Task>(1);
        std::thread::Builder::new()
            .name("device".to_owned())
            .spawn(move || {
                while let Some(task) = queue.blocking_recv() {
                    task.run(device.as_mut());
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

impl Task {
    fn run(self, device: &mut dyn Device) {
        let Task { prepared, cancel, mut on_iteration, span, reply, slot } = self;
        let outcome = {
            let _entered = span.enter();
            caught(|| job::run(&prepared, device, &cancel, &mut *on_iteration))
        };
        // All of the job's iterations are told before its outcome.
        drop(on_iteration);
        drop(prepared);
        drop(slot);
        let _ = reply.send(outcome);
    }
}
