//! A pipeline and its run: jobs are claimed, worked on and ended, or given back.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tesserae_mesh::device::Cancel;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::mesh::Limits;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::Instrument;

use super::bounds::AGAIN;
use super::device_thread::DeviceThread;
use super::leases::{Lease, Leases};
use super::memory::{Memory, Slot};
use super::rows::Log;
use crate::files::Files;
use crate::files::storage::Storage;
use crate::guard::access::tokens::Tokens;
use crate::metrics::Metrics;
use crate::ops::trace::TraceParent;
use crate::store::live::Live;
use crate::store::{self, Claiming, End, Ending, Job, State, Store, Summary, Ticket};

pub(crate) struct Pipeline {
    pub store: Arc<Store>,
    pub files: Arc<Files>,
    pub storage: Arc<Storage>,
    pub device: DeviceThread,
    pub limits: Limits,
    pub time: Option<Duration>,
    pub patience: Duration,
    pub slots: Arc<Semaphore>,
    /// The one slot for a tenant without a running job.
    pub newcomer: Arc<Semaphore>,
    /// With what each tenant may use of the queue.
    pub tokens: watch::Receiver<Arc<Tokens>>,
    /// Name of this process for clients, and that of its device.
    pub worker: Arc<str>,
    pub device_name: String,
    pub memory: Memory,
    pub leases: Arc<Leases>,
    pub metrics: Arc<Metrics>,
    pub live: Arc<Live>,
}

pub(super) struct Attempt {
    pub pipeline: Arc<Pipeline>,
    pub ticket: Ticket,
    pub job: Job,
    pub log: Arc<Log>,
    pub started: Instant,
    lease: Lease,
    abort: CancellationToken,
}

#[derive(Debug)]
pub(super) enum Verdict {
    Ended(Ending),
    /// It is to be tried again: the device or the process failed and not the mesh, or it was broken off without fault.
    Released(Option<Error>),
    /// Another process has it by now.
    Lost,
}

type Claimed = (OwnedSemaphorePermit, Ticket, Job);

impl Pipeline {
    /// Works on jobs until `stop`; jobs claimed by then end, or are released when `abort` breaks them off.
    pub async fn run(self, stop: CancellationToken, abort: CancellationToken) {
        let this = Arc::new(self);
        let jobs = TaskTracker::new();
        let keeper = Arc::clone(&this);
        let leases = tokio::spawn(async move {
            let Self { store, worker, device_name, leases, .. } = &*keeper;
            leases.keep(store, worker, device_name).await
        });
        let mut arrivals = this.store.arrivals();
        while let Some(claimed) = this.next(&mut arrivals, &stop).await {
            for (slot, ticket, job) in claimed {
                let parent = job.spec.trace_parent.as_deref().and_then(TraceParent::parse);
                // its level is error so that every line about the job names it
                let span = tracing::error_span!(
                    "job",
                    id = %job.id,
                    attempt = ticket.attempt,
                    trace = parent.as_ref().map(TraceParent::trace),
                    tenant = job.spec.tenant,
                    faces = tracing::field::Empty,
                    clusters = job.spec.parameters.clusters,
                );
                let (lease, started) = (this.leases.hold(ticket), Instant::now());
                let (pipeline, abort, log) = (Arc::clone(&this), abort.clone(), Arc::default());
                let attempt = Attempt { pipeline, ticket, job, lease, log, started, abort };
                jobs.spawn(attempt.work(Slot::new(slot)).instrument(span));
            }
        }
        jobs.close();
        jobs.wait().await;
        leases.abort();
        let _ = leases.await;
    }

    /// The next jobs, once there are slots and jobs, and what it takes to work on them; none when it is time to stop.
    async fn next(
        self: &Arc<Self>,
        arrivals: &mut watch::Receiver<()>,
        stop: &CancellationToken,
    ) -> Option<Vec<Claimed>> {
        let (mut slots, mut newcomer) = (Vec::new(), None);
        let mut tokens = self.tokens.clone();
        loop {
            let ready = async {
                if slots.is_empty() && newcomer.is_none() {
                    tokio::select! {
                        slot = Arc::clone(&self.slots).acquire_owned() => slots.push(slot.ok()?),
                        slot = Arc::clone(&self.newcomer).acquire_owned() => newcomer = Some(slot.ok()?),
                    }
                }
                while let Ok(slot) = Arc::clone(&self.slots).try_acquire_owned() {
                    slots.push(slot);
                }
                if newcomer.is_none() {
                    newcomer = Arc::clone(&self.newcomer).try_acquire_owned().ok();
                }
                self.storage.works().await;
                self.device.is_there().await;
                Some(())
            };
            tokio::select! {
                biased;
                () = stop.cancelled() => return None,
                ready = ready => ready?,
            }
            // seen before looking, so that what arrives while looking is noticed
            arrivals.borrow_and_update();
            let claiming = Claiming {
                limit: slots.len(),
                newcomers: usize::from(newcomer.is_some()),
                lease: super::leases::TERM,
                worker: Arc::clone(&self.worker),
                shares: Arc::clone(&tokens.borrow_and_update().shares),
            };
            // Not broken off in the middle: what it takes would stay taken.
            let again = match self.store.claim_as(claiming).await {
                // a start that is due must not spin
                Ok((claimed, wait)) if claimed.is_empty() => wait.map(|wait| wait.max(Duration::from_millis(1))),
                Ok((claimed, _)) => {
                    let with_slot = |(ticket, job)| Some((slots.pop().or_else(|| newcomer.take())?, ticket, job));
                    return Some(claimed.into_iter().filter_map(with_slot).collect());
                }
                Err(error) => {
                    tracing::error!(%error, "no job can be claimed");
                    Some(AGAIN)
                }
            };
            tokio::select! {
                biased;
                () = stop.cancelled() => return None,
                changed = arrivals.changed() => changed.ok()?,
                changed = tokens.changed() => changed.ok()?,
                slot = Arc::clone(&self.slots).acquire_owned(), if slots.is_empty() => slots.push(slot.ok()?),
                () = tokio::time::sleep(again.unwrap_or_default()), if again.is_some() => {}
            }
        }
    }
}

impl Attempt {
    async fn work(self, slot: Slot) {
        let metrics = &self.pipeline.metrics;
        metrics.claimed(&self.job);
        tracing::debug!(format = self.job.spec.format.name(), bytes = self.job.spec.bytes, "started");
        let cancel = Cancel::default();
        let broken_off = CancellationToken::new();
        let _break_off = broken_off.clone().drop_guard();
        let outcome = tokio::select! {
            biased;
            outcome = self.cluster(&slot, &cancel, broken_off) => outcome.map_err(judge),
            verdict = self.broken_off() => Err(verdict),
        };
        // What still runs for this job writes nothing any more, and stops soon.
        cancel.cancel();
        let verdict = match outcome {
            Ok(outcome) => {
                metrics.reported(&outcome.report);
                let writing = Instant::now();
                let verdict = self.write(slot, outcome).instrument(tracing::info_span!("write")).await;
                metrics.written(&self.job, writing.elapsed());
                verdict
            }
            Err(verdict) => verdict,
        };
        self.conclude(verdict).await;
    }

    /// Completes when the attempt is not to go on, with its verdict.
    pub(super) async fn broken_off(&self) -> Verdict {
        tokio::select! {
            biased;
            () = self.cancel_requested() => Verdict::Ended(End::Cancelled.into()),
            () = self.lease.lost.cancelled() => Verdict::Lost,
            () = self.abort.cancelled() => match self.pipeline.store.is_durable() {
                true => Verdict::Released(None),
                false => {
                    let why = "the service was stopped before the job ended, and keeps no jobs; submit it again";
                    judge(Error::unavailable(why))
                }
            },
        }
    }

    /// Stores the outcome of an attempt, and removes the files that are not needed any more.
    async fn conclude(&self, verdict: Verdict) {
        let Self { pipeline, ticket, job, .. } = self;
        let Pipeline { store, files, metrics, .. } = &**pipeline;
        let elapsed = self.started.elapsed();
        let milliseconds = elapsed.as_millis() as u64;
        let mut may_have_files = true;
        // for a retry, if it has failed
        let mut keeps_upload = matches!(verdict, Verdict::Released(_));
        let state = match verdict {
            Verdict::Ended(mut ending) => {
                match &ending.end {
                    End::Succeeded(Summary { faces, .. }) => tracing::info!(milliseconds, faces, "succeeded"),
                    End::Cancelled => tracing::info!(milliseconds, "cancelled"),
                    End::Failed(error) => tracing::warn!(milliseconds, kind = error.kind.slug(), "failed: {error}"),
                }
                let (state, problem, _) = ending.end.parts();
                keeps_upload = store::keeps_upload(problem);
                metrics.ended(job, state, elapsed);
                may_have_files = !matches!(&ending.end, End::Succeeded(summary) if summary.is_small);
                ending.rest = self.log.lock().clone();
                // the end of a job makes room later, and takes some first
                let makes_room = state != State::Succeeded;
                self.until_stored(makes_room, || store.end(*ticket, ending.clone())).await.map(|()| state)
            }
            Verdict::Released(fault) => {
                match &fault {
                    Some(error) => {
                        tracing::warn!(milliseconds, "the attempt failed: {error}");
                        metrics.attempt_failed(error.kind);
                    }
                    None => tracing::info!(milliseconds, "broken off; it waits again"),
                }
                let outcome = self.until_stored(false, || store.release(*ticket, fault.clone())).await;
                if let (Ok(State::Failed), Some(error)) = (&outcome, &fault) {
                    metrics.families.poison.get_or_create(&[("reason", error.kind.slug())]).inc();
                }
                outcome
            }
            Verdict::Lost => Err(Error::conflict("the lease was lost: another process may run the job")),
        };
        if may_have_files && state != Ok(State::Succeeded) {
            files.remove_result(job.id, ticket.attempt).await;
        }
        match state {
            Ok(State::Failed) if keeps_upload => {}
            Ok(state) if state.is_ended() && !job.spec.is_small => files.remove_upload(job.id).await,
            Ok(_) => {}
            Err(error) if error.kind == Kind::Conflict => tracing::warn!("nothing of this attempt counts: {error}"),
            Err(error) => tracing::error!(%error, "the end of a job cannot be stored; it will be run again"),
        }
    }

    /// Writes to the store until the disk works, or it is time to go. What makes room later may use the ballast.
    async fn until_stored<T, F: Future<Output = Result<T>>>(
        &self,
        makes_room: bool,
        mut write: impl FnMut() -> F,
    ) -> Result<T> {
        loop {
            match write().await {
                Err(error) if error.is_of_storage() && !self.abort.is_cancelled() => {
                    tracing::warn!(%error, "what happened cannot be stored yet");
                    self.abort.run_until_cancelled(tokio::time::sleep(AGAIN)).await;
                    if makes_room && error.kind == Kind::InsufficientStorage {
                        self.pipeline.files.give_up_ballast().await;
                    }
                }
                outcome => return outcome,
            }
        }
    }

    async fn cancel_requested(&self) {
        let asked = loop {
            match self.pipeline.store.watch(self.job.id).await {
                Ok(Some(mut pulses)) => break pulses.wait_for(|pulse| pulse.cancel_requested).await.is_ok(),
                Err(error) if error.is_of_storage() => tokio::time::sleep(AGAIN).await,
                Ok(None) | Err(_) => break false,
            }
        };
        if !asked {
            std::future::pending::<()>().await;
        }
    }
}

pub(super) fn judge(error: Error) -> Verdict {
    match error.kind {
        Kind::Cancelled => Verdict::Ended(End::Cancelled.into()),
        Kind::Conflict => Verdict::Lost,
        Kind::DeviceLost => Verdict::Released(Some(error)),
        _ => Verdict::Ended(End::Failed(error).into()),
    }
}

/// Name of this process in the jobs that it works on.
pub(crate) fn worker_name() -> String {
    let file = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let host = file.or_else(|| std::env::var("HOSTNAME").ok()).unwrap_or_default();
    let is_name = |host: &&str| (1..=128).contains(&host.len()) && host.chars().all(|c| c.is_ascii_graphic());
    format!("{}-{}", Some(host.trim()).filter(is_name).unwrap_or("tesserae"), std::process::id())
}
