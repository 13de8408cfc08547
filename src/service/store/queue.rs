//! Jobs from their creation through their attempts to their end.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use super::events::What;
use super::fairness::Shares;
use super::job::{Job, JobId, Progress, SmallBlob, Spec, State, Summary, Ticket};
use crate::error::{Error, Kind, Result};

/// A job to be added.
#[derive(Debug, Clone)]
pub(in crate::service) struct NewJob {
    /// Its name.
    pub id: JobId,
    /// What it is.
    pub spec: Spec,
    /// The key of the request, so that a repeated request gets the same job.
    pub idempotency: Option<Idempotency>,
    /// Small blobs of its upload, kept until it ends, and beyond that when it is [given up](Job::keeps_upload).
    pub upload: Vec<SmallBlob>,
}

/// The `Idempotency-Key` of a request, and the request it stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::service) struct Idempotency {
    /// What the client sent; unique within the tenant as long as the job is kept.
    pub key: String,
    /// Digest of everything else in the request.
    pub request: String,
}

/// What came of adding a job.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) enum Created {
    /// It is new.
    New(Job),
    /// An earlier request with this key added this one; nothing was added.
    Known(Job),
}

/// What a store allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::service) struct Rules {
    /// Jobs that may wait at a time.
    pub max_queued: usize,
    /// Counted attempts after which a job that keeps being released has failed.
    pub max_attempts: u32,
    /// Pause of a job after the first crash during which it ran.
    pub crash_pause: Duration,
}

/// Longest pause of a job after a crash, unless [`Rules::crash_pause`] is longer.
const LONGEST_PAUSE: Duration = Duration::from_secs(600);

/// Longest time in which nothing is claimed because of a suspect: before it starts, and from its start on.
pub(in crate::service) const ALONE: Duration = Duration::from_secs(30);

/// Crashes after which a suspect is to run alone.
pub(in crate::service::store) const ALONE_FROM: u32 = 2;

/// Crashes after which the only old suspect is blamed for another one, whatever started after it.
pub(in crate::service::store) const BLAMED_FROM: u32 = 5;

impl Rules {
    /// [`Kind::QueueFull`] when as many jobs wait as may.
    pub(in crate::service::store) fn check_room(&self, waiting: u64) -> Result<()> {
        match waiting < self.max_queued as u64 {
            true => Ok(()),
            false => Err(Error::new(
                Kind::QueueFull,
                format_args!("as many jobs wait as may; try again later: {}", self.max_queued),
            )),
        }
    }

    /// The pause of a job that ran during this many crashes.
    pub(in crate::service::store) fn pause(&self, crashes: u32) -> Duration {
        let factor = 10u32.saturating_pow(crashes.saturating_sub(1));
        self.crash_pause.saturating_mul(factor).min(LONGEST_PAUSE.max(self.crash_pause))
    }
}

/// Of jobs that had begun when their process died, with the crashes before and the time of each start: the one that the
/// crash counts for, if any. See [After a crash](super).
pub(in crate::service::store) fn guilty<T: Ord>(begun: &[(u32, T)]) -> Option<usize> {
    let last = begun.iter().map(|(_, started)| started).max();
    let old: Vec<usize> = (0..begun.len()).filter(|&index| begun[index].0 >= ALONE_FROM).collect();
    match (begun, &old[..]) {
        ([_], _) => Some(0),
        (_, &[only]) if Some(&begun[only].1) == last || begun[only].0 >= BLAMED_FROM => Some(only),
        _ => None,
    }
}

/// What a worker claims.
#[derive(Debug, Clone)]
pub(in crate::service) struct Claiming {
    /// Most jobs.
    pub limit: usize,
    /// Most further jobs, only of tenants without a running job.
    pub newcomers: usize,
    /// For how long the jobs are leased.
    pub lease: Duration,
    /// Name of the worker.
    pub worker: Arc<str>,
    /// What each tenant may use.
    pub shares: Arc<Shares>,
}

/// What came of a retry.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) enum Retried {
    /// It waits again.
    Queued(Box<Job>),
    /// It is in another state than failed, and was left as it is.
    NotFailed(State),
    /// There is no such job.
    Unknown,
}

/// Why a running job is given back.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) enum Release {
    /// The attempt failed, and another one may not. It counts if it had begun.
    Failed(Error),
    /// The attempt was broken off without fault; it does not count.
    Free,
}

/// How a job ends.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) enum End {
    /// With a result.
    Succeeded(Summary),
    /// With an error.
    Failed(Error),
    /// On request.
    Cancelled,
}

impl End {
    /// The state that the job ends in, why it failed, and what it gave.
    pub fn parts(&self) -> (State, Option<&Error>, Option<&Summary>) {
        match self {
            Self::Succeeded(summary) => (State::Succeeded, None, Some(summary)),
            Self::Failed(error) => (State::Failed, Some(error), None),
            Self::Cancelled => (State::Cancelled, None, None),
        }
    }
}

/// The end of a running job, and what comes with it, in one step.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) struct Ending {
    /// How it ends.
    pub end: End,
    /// The last events before that, and the progress after them.
    pub rest: Option<(Vec<What>, Progress)>,
    /// Small blobs of the result.
    pub result: Vec<SmallBlob>,
}

impl From<End> for Ending {
    fn from(end: End) -> Self {
        Self { end, rest: None, result: Vec::new() }
    }
}

/// A page of the list of jobs.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in crate::service) struct Page {
    /// The jobs, newest first.
    pub jobs: Vec<Job>,
    /// Where the next page begins; none on the last.
    pub next: Option<String>,
}

/// Which part of the list of jobs.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::service) struct ListQuery {
    /// Only jobs of this tenant.
    pub tenant: Option<String>,
    /// Only jobs in this state.
    pub state: Option<State>,
    /// Go on where an earlier page ended: its `next`.
    pub cursor: Option<String>,
    /// Most jobs.
    pub limit: usize,
}

/// Takes jobs in, hands them to workers, and takes their ends.
///
/// Times of leases and pauses are durations here: only the store reads a clock, so that the workers' clocks need not
/// agree.
#[async_trait]
pub(in crate::service) trait Queue: fmt::Debug + Send + Sync {
    /// [`Kind::QueueFull`] when [`create`](Self::create) would be refused now, so that an upload need not come first.
    async fn check_room(&self) -> Result<()>;

    /// Whether a job of the tenant was added with this key: then [`create`](Self::create) adds none.
    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool>;

    /// Adds a job at the end of the queue. [`Kind::QueueFull`] when as many wait as may; [`Kind::KeyReused`] when its
    /// key stands for another request. When this returns, the job is as durable as anything in this store.
    async fn create(&self, job: NewJob) -> Result<Created>;

    /// The job as it is now.
    async fn get(&self, id: JobId) -> Result<Option<Job>>;

    /// A page of jobs, newest first. A cursor that this store did not give is [`Kind::InvalidParameter`].
    async fn list(&self, query: &ListQuery) -> Result<Page>;

    /// Claims waiting jobs, in the order that the [module](self) describes. They are running from then on.
    async fn claim_as(&self, claiming: Claiming) -> Result<Vec<(Ticket, Job)>>;

    /// Claims jobs of tenants with equal shares.
    #[cfg(test)]
    async fn claim(&self, limit: usize, lease: Duration) -> Result<Vec<(Ticket, Job)>> {
        let (worker, shares) = ("test".into(), Arc::default());
        self.claim_as(Claiming { limit, newcomers: 0, lease, worker, shares }).await
    }

    /// Time until a job that the last claim passed over may be claimed, if that needs time only.
    fn next_start(&self) -> Option<Duration>;

    /// The worker begins to read the mesh: from now on the attempt counts. Small uploads begin with their claim.
    /// Nothing happens when the attempt has begun already.
    async fn begin(&self, ticket: Ticket) -> Result<()>;

    /// Puts a failed job back into the queue, with no attempt counted. Its upload must still be there.
    /// [`Kind::QueueFull`] when as many jobs wait as may.
    async fn retry(&self, id: JobId) -> Result<Retried>;

    /// Makes leases end this long after now, by the clock of the store; returns the tickets that are over.
    async fn heartbeat(&self, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>>;

    /// Gives a running job back: it waits again, or has failed ([`Kind::Poison`]) after too many attempts, or is
    /// cancelled where that was requested.
    async fn release(&self, ticket: Ticket, release: Release) -> Result<State>;

    /// Releases the running jobs whose lease is over by the clock of the store; returns the tickets that held them.
    async fn reclaim(&self) -> Result<Vec<Ticket>>;

    /// Ends a running job. Small blobs of its upload go, unless it is given up.
    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()>;

    /// Ends a running job without further events or blobs.
    #[cfg(test)]
    async fn finish(&self, ticket: Ticket, end: End) -> Result<()> {
        self.end(ticket, end.into()).await
    }

    /// Whether blobs of `bytes` together are small, and better kept here than in files.
    fn takes(&self, bytes: u64) -> bool;

    /// A small blob of a job; none when there is no such blob, or job.
    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>>;

    /// Cancels a job: a queued one at once, a running one when its worker stops; an ended one stays as it is. The job
    /// after that; none when there is no such job.
    async fn cancel(&self, id: JobId) -> Result<Option<Job>>;

    /// Changes whenever a job may be claimed that could not be before: idle workers wait for it. Marked as changed from
    /// the start.
    fn arrivals(&self) -> watch::Receiver<u64>;

    /// Number of jobs in each state, in the order of [`State::ALL`].
    async fn counts(&self) -> Result<[u64; State::ALL.len()]>;

    /// Number of jobs of a tenant that wait.
    async fn waiting_of(&self, tenant: &str) -> Result<u64>;

    /// When the job was accepted that waits longest; none when no job waits.
    async fn oldest_queued(&self) -> Result<Option<SystemTime>>;
}

/// The error of a ticket that is over.
pub(in crate::service::store) fn not_yours(id: JobId) -> Error {
    Error::new(Kind::Conflict, format_args!("the job is no longer this worker's: {id}"))
}

/// The error of a key that stands for another request.
pub(in crate::service::store) fn reused_key(key: &str) -> Error {
    Error::new(
        Kind::KeyReused,
        format_args!(
            "another request came with this Idempotency-Key before; send a new key with a new request: {key:?}"
        ),
    )
}

/// Why a job is released whose worker is gone.
pub(in crate::service::store) fn lease_is_over() -> Error {
    Error::new(Kind::Unavailable, "the service ended, or stood still, while the job ran")
}

/// The error of a job that was given back too often.
pub(in crate::service::store) fn given_up(attempts: u64, last: &Error) -> Error {
    Error::new(
        Kind::Poison,
        format_args!(
            "the job was given up after {attempts} attempt{}, of which the last failed: {last}; its upload is kept \
             until the job is deleted: to run it again, POST to its path followed by /retry",
            if attempts == 1 { "" } else { "s" }
        ),
    )
}
