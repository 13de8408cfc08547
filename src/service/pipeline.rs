//! From the queue to results: read → cluster → write, for several jobs at a time.
//!
//! Jobs are claimed in the order of submission. Each holds a slot until it ends, so that no more meshes are in memory
//! than there are slots; within that, meshes are read and results written on tokio's blocking threads while the one
//! [`device_thread`] clusters. A job that fails, or panics, fails alone.

pub(super) mod device_thread;
mod stages;

use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::Instrument;

use self::device_thread::DeviceThread;
use super::files::Files;
use super::metrics::Metrics;
use super::store::{End, Job, JobStore, State, Ticket};
use super::trace::TraceParent;
use crate::device::Cancel;
use crate::error::{Error, Kind, Result};
use crate::mesh::Limits;

/// What works on jobs.
#[derive(Debug)]
pub(super) struct Pipeline {
    store: Arc<dyn JobStore>,
    files: Arc<Files>,
    limits: Limits,
    slots: Arc<Semaphore>,
    device: DeviceThread,
    metrics: Arc<Metrics>,
}

impl Pipeline {
    /// A pipeline with room for `slots` meshes.
    pub fn new(
        store: Arc<dyn JobStore>,
        files: Arc<Files>,
        limits: Limits,
        slots: usize,
        device: DeviceThread,
        metrics: Arc<Metrics>,
    ) -> Self {
        Self { store, files, limits, slots: Arc::new(Semaphore::new(slots)), device, metrics }
    }

    /// Works on jobs until `stop`; jobs claimed by then end, at the latest when `abort` asks them to.
    pub async fn run(self, stop: CancellationToken, abort: CancellationToken) {
        let this = Arc::new(self);
        let jobs = TaskTracker::new();
        let mut arrivals = this.store.arrivals();
        while let Some((slot, ticket, job)) = this.next(&mut arrivals, &stop).await {
            let span = tracing::info_span!(
                "job",
                id = %job.id,
                trace = tracing::field::Empty,
                tenant = job.spec.tenant,
                faces = tracing::field::Empty,
                clusters = job.spec.parameters.clusters,
            );
            if let Some(parent) = job.spec.trace_parent.as_deref().and_then(TraceParent::parse) {
                parent.continued_by(&span);
            }
            let work = Arc::clone(&this).work(slot, ticket, job, abort.clone());
            jobs.spawn(work.instrument(span));
        }
        jobs.close();
        jobs.wait().await;
    }

    /// The next job, once there are a slot and a job; none when it is time to stop.
    async fn next(
        &self,
        arrivals: &mut tokio::sync::watch::Receiver<u64>,
        stop: &CancellationToken,
    ) -> Option<(OwnedSemaphorePermit, Ticket, Job)> {
        let search = async {
            let slot = Arc::clone(&self.slots).acquire_owned().await.ok()?;
            loop {
                // seen before looking, so that what arrives while looking is noticed
                arrivals.borrow_and_update();
                match self.store.claim(1, std::time::Duration::from_secs(3600)).await {
                    Ok(mut claimed) => match claimed.pop() {
                        Some((ticket, job)) => return Some((slot, ticket, job)),
                        None => arrivals.changed().await.ok()?,
                    },
                    Err(error) => {
                        tracing::error!(%error, "no job can be claimed");
                        tokio::time::sleep(std::time::Duration::from_secs(1)).await;
                    }
                }
            }
        };
        tokio::select! {
            biased;
            () = stop.cancelled() => None,
            found = search => found,
        }
    }

    /// Works on one job until it ends.
    async fn work(self: Arc<Self>, slot: OwnedSemaphorePermit, ticket: Ticket, job: Job, abort: CancellationToken) {
        let started = Instant::now();
        self.metrics.claimed(&job);
        tracing::info!(format = job.spec.format.name(), bytes = job.spec.bytes, "started");
        let cancel = Cancel::default();
        let slot = Arc::new(slot);
        let outcome = tokio::select! {
            biased;
            outcome = self.cluster(&slot, ticket, &job, &cancel) => outcome,
            () = self.cancel_requested(&job) => Err(Error::cancelled()),
            () = abort.cancelled() => Err(Error::new(
                Kind::Unavailable,
                "the service was stopped before the job ended; submit it again",
            )),
        };
        // What still runs for this job writes nothing any more, and stops soon.
        cancel.cancel();
        let result = match outcome {
            Ok(outcome) => {
                self.metrics.reported(&outcome.report);
                let writing = Instant::now();
                let summary = self.write(slot, &job, outcome, started).instrument(tracing::info_span!("write")).await;
                self.metrics.written(&job, writing.elapsed());
                summary
            }
            Err(error) => Err(error),
        };
        let milliseconds = started.elapsed().as_millis() as u64;
        let end = match result {
            Ok(summary) => {
                tracing::info!(milliseconds, "succeeded");
                End::Succeeded(summary)
            }
            Err(error) if error.kind == Kind::Cancelled => {
                tracing::info!(milliseconds, "cancelled");
                End::Cancelled
            }
            Err(error) => {
                tracing::warn!(milliseconds, kind = error.kind.slug(), "failed: {error}");
                End::Failed(error)
            }
        };
        let (state, error) = match &end {
            End::Succeeded(_) => (State::Succeeded, None),
            End::Failed(error) => (State::Failed, Some(error.kind)),
            End::Cancelled => (State::Cancelled, None),
        };
        self.metrics.ended(&job, state, started.elapsed(), error);
        if let Err(error) = self.store.finish(ticket, end).await {
            tracing::error!(%error, "the end of a job cannot be stored");
        }
        self.files.remove_upload(job.id).await;
    }

    /// Ends when someone asks for the job's end.
    async fn cancel_requested(&self, job: &Job) {
        let asked = match self.store.watch(job.id).await {
            Ok(Some(mut pulses)) => pulses.wait_for(|pulse| pulse.cancel_requested).await.is_ok(),
            Ok(None) | Err(_) => false,
        };
        if !asked {
            std::future::pending::<()>().await;
        }
    }
}

/// Runs `work`; a panic becomes an error.
fn caught<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(Error::new(Kind::Internal, "the job ran into a defect of the service; its log says more"))
    })
}
