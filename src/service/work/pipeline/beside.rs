//! Short meshes beside a long one, where the cpu clusters.
//!
//! A mesh that waits for the device while that works on one of at least four times its cost need not wait: it is
//! clustered at the same time, by threads of its own, one such mesh at a time. The system shares the processors between
//! both, so that a short job takes at most about twice its own time, and a long one is held up by no more than that.
//! Labels depend on neither.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use rayon::ThreadPool;
use tesserae_mesh::device::Device;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::Outcome;
use tesserae_mesh::report::DeviceKind;
use tokio::sync::{Semaphore, oneshot};

use super::bounds::{caught, pool, within};
use super::task::Task;
use crate::metrics::Metrics;
use crate::ops::faults::Faults;

/// Threads for one short mesh at a time.
pub(super) struct Beside {
    turn: Arc<Semaphore>,
    threads: ThreadPool,
    /// Makes devices for them.
    like: Mutex<Box<dyn Device>>,
}

impl Beside {
    /// Threads beside those of `device`; none unless it is a cpu that takes several meshes at a time.
    pub fn start(device: &dyn Device) -> Result<Option<Self>> {
        let Some(like) = device.another().filter(|_| device.info().kind == DeviceKind::Cpu) else {
            return Ok(None);
        };
        let threads = pool(0, |index| format!("beside-{index}"))?;
        Ok(Some(Self { turn: Arc::new(Semaphore::new(1)), threads, like: Mutex::new(like) }))
    }

    /// Clusters a mesh, in its turn among the short ones, and makes results of that. [`Kind::TimeLimit`] when it takes
    /// longer than `limit`, not counting the wait.
    pub async fn run(
        &self,
        task: Task,
        metrics: Arc<Metrics>,
        faults: Faults,
        limit: Option<Duration>,
    ) -> Result<Outcome> {
        let gone = || Error::new(Kind::Internal, "the threads for short meshes are gone");
        let turn = Arc::clone(&self.turn).acquire_owned().await.map_err(|_| gone())?;
        let device = self.like.lock().another().ok_or_else(gone)?;
        let (reply, outcome) = oneshot::channel();
        self.threads.spawn(move || {
            let span = task.span.clone();
            let done = caught(|| span.in_scope(|| task.run_on(device, &metrics)));
            // the next one need not wait for the results
            drop(turn);
            let outcome = done.and_then(|done| caught(|| span.in_scope(|| done.finish(&faults))));
            // the receiver may be gone
            let _ = reply.send(outcome);
        });
        within(limit, async { outcome.await.map_err(|_| gone())? }).await
    }
}
