//! Where jobs and their events are kept.
//!
//! [`JobStore`] is what the service asks of a store; `conformance` is the suite that every store passes. A store knows
//! nothing of HTTP, of files or of devices. [`sqlite`] keeps jobs on disk; [`memory`] forgets everything when the process
//! ends.
//!
//! # The life of a job
//!
//! ```text
//! create ─→ queued ─ claim ─→ running ─ finish ─→ succeeded | failed | cancelled ─ delete ─→ gone
//!            │ ↑└──── release ───┘                              │ │        │
//!            │ │           └──── too often ─────────────────────┘ │        │
//!            │ └─────────────────── retry ────────────────────────┘        │
//!            └───────── cancel ────────────────────────────────────────────┘
//! ```
//!
//! Every change of state is an event of the job, appended in the same step: a reader of all events knows the state.
//! Events are numbered from 1 without gaps. What a worker writes carries the [`Ticket`] of its claim; a ticket that is
//! no longer the job's (it ended, or was claimed again) writes nothing and gets [`Kind::Conflict`](crate::Kind).
//!
//! A claim is a lease: a worker prolongs the leases of its jobs by [`heartbeat`](JobStore::heartbeat), and jobs whose
//! lease is over are [reclaimed](JobStore::reclaim). A released job waits again at its old place in the queue, and its
//! events go on with the next number. An attempt counts from the moment the worker [begins](JobStore::begin) to read the
//! mesh; a claim alone never counts. After [`Rules::max_attempts`] counted attempts that failed, the job has failed.
//!
//! # Which job is claimed
//!
//! The tenant with the fewest running jobs divided by its weight comes first; among equals, the tenant whose virtual time
//! is earliest ([`fairness`]); then the job with the highest priority, then the oldest one. So a priority orders the jobs
//! of one tenant, and decides between tenants only where these are equal. A tenant at its limit of running jobs is passed
//! over. Each job claimed costs a pass over the tenants with waiting jobs, and one look-up in an index for each of the
//! tenants that are equal.
//!
//! # After a crash
//!
//! A crash is a start that finds running jobs. Those that had not begun wait again as if nothing had happened. Those that
//! had begun become *suspects*: any of them may have killed the process. The crash counts as an attempt for a job only if
//! it was the only one that had begun, or the only one of them that had been suspect in two crashes or more. In the
//! second case, a job that had begun and was claimed later may as well be the cause: then the crash counts for neither,
//! unless the suspect was in [five](BLAMED_FROM) crashes before, so that a job that kills the process late is given up,
//! too. Suspects start one at a time, and each pauses before it starts again, [ten times as long](Rules::pause) after
//! every further crash. After its second crash a suspect runs alone: nothing else is claimed while it starts, for
//! [`ALONE`] at most. So a job that kills the process is given up, and its neighbours are not.

#[cfg(test)]
pub(super) mod conformance;
mod cursor;
pub(super) mod fairness;
pub(super) mod memory;
mod pulses;
pub(super) mod sqlite;

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tokio_util::bytes::Bytes;
use utoipa::ToSchema;
use uuid::Uuid;

use self::fairness::Shares;
use crate::error::{Error, Kind, Result};
use crate::mesh::Format;
use crate::parameters::Parameters;
use crate::report::Phase;

/// The tenant of every job of a service without tokens.
pub(super) const LOCAL_TENANT: &str = "local";

/// Name of a job: 122 random bits, so that nobody guesses another's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, ToSchema)]
#[schema(value_type = String, format = "uuid")]
pub(super) struct JobId(Uuid);

impl JobId {
    /// A new one.
    pub fn random() -> Self {
        Self(Uuid::new_v4())
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.as_hyphenated().fmt(f)
    }
}

impl Serialize for JobId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl FromStr for JobId {
    type Err = Error;

    /// Takes the hyphenated form only, so that a job has one address.
    fn from_str(text: &str) -> Result<Self> {
        Uuid::try_parse(text).ok().map(Self).filter(|id| id.to_string() == text).ok_or_else(|| no_such_job(text))
    }
}

/// The error for a job that does not exist.
pub(super) fn no_such_job(id: impl fmt::Display) -> Error {
    Error::new(Kind::NotFound, format_args!("there is no such job: {id}"))
}

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(super) enum State {
    /// Accepted; waits for its turn.
    Queued,
    /// Being read, clustered or written.
    Running,
    /// Ended; labels and report are there.
    Succeeded,
    /// Ended; `problem` says why.
    Failed,
    /// Ended because someone asked for it.
    Cancelled,
}

impl State {
    /// Every state.
    pub const ALL: [State; 5] = [State::Queued, State::Running, State::Succeeded, State::Failed, State::Cancelled];

    /// As it is written in JSON and in queries.
    pub fn name(self) -> &'static str {
        match self {
            State::Queued => "queued",
            State::Running => "running",
            State::Succeeded => "succeeded",
            State::Failed => "failed",
            State::Cancelled => "cancelled",
        }
    }

    /// Whether nothing about the job will change any more.
    pub fn is_ended(self) -> bool {
        match self {
            State::Queued | State::Running => false,
            State::Succeeded | State::Failed | State::Cancelled => true,
        }
    }
}

/// What was uploaded, by whom, and what is to be done with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Spec {
    /// Name of the tenant whose job it is: [`LOCAL_TENANT`] for a service without tokens.
    pub tenant: String,
    /// The `traceparent` of the request (W3C Trace Context), which the work on the job continues.
    pub trace_parent: Option<String>,
    /// Where the end of the job is to be told.
    pub webhook: Option<String>,
    /// What to do.
    pub parameters: Parameters,
    /// Name that the client gave the mesh file. For people; never a path here.
    pub file_name: Option<String>,
    /// Format of the mesh.
    pub format: Format,
    /// Length of the mesh file.
    pub bytes: u64,
    /// Names of the buffers that came with the mesh, in the order of their parts.
    pub buffers: Vec<String>,
    /// Whether a list of seeds came with the mesh.
    pub listed_seeds: bool,
    /// Whether weights came with the mesh.
    pub has_weights: bool,
    /// Whether all of these are small blobs, which the store keeps.
    #[serde(default)]
    pub is_small: bool,
    /// Jobs of a tenant with a higher priority are claimed first. Left out where it is 0, so that the digest of an
    /// idempotent request is the same as in releases without priorities.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub priority: i8,
}

fn is_zero(priority: &i8) -> bool {
    *priority == 0
}

/// The priorities that a job may have.
pub(super) const PRIORITIES: std::ops::RangeInclusive<i8> = -100..=100;

/// How far a running job is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Progress {
    /// Iterations made.
    pub iterations: u32,
    /// Phase of the last of them.
    pub phase: Option<Phase>,
    /// Hierarchies: rounds made.
    pub rounds: u32,
    /// Hierarchies: clusters left.
    pub clusters_left: Option<u64>,
    /// Energy after the last iteration or round.
    pub energy: Option<f64>,
}

/// What is known about the result of a job without opening it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Summary {
    /// Faces of the mesh, each with a label.
    pub faces: u64,
    /// Clusters.
    pub clusters: u64,
    /// Whether there are labels at that number: not for a whole hierarchy.
    pub has_labels: bool,
    /// The report's `labels_sha256`.
    #[serde(default)]
    pub labels_sha256: Option<String>,
    /// Whether the result is small blobs, which the store keeps.
    #[serde(default)]
    pub is_small: bool,
}

/// Bytes of all small blobs of an upload, or of a result, at the most.
pub(super) const SMALL_BLOBS: u64 = 256 << 10;

/// A file of a job that is so small that it is kept with the job: that costs no file, and no wait for the disk of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SmallBlob {
    /// Its name; unique among those of the job.
    pub name: String,
    /// What it holds.
    pub bytes: Bytes,
}

/// A job to be added.
#[derive(Debug, Clone)]
pub(super) struct NewJob {
    /// Its name.
    pub id: JobId,
    /// What it is.
    pub spec: Spec,
    /// By what the client knows it again when it asks twice.
    pub idempotency: Option<Idempotency>,
    /// Small blobs of its upload, kept until it ends, and beyond that when it is [given up](Job::keeps_upload).
    pub upload: Vec<SmallBlob>,
}

/// The `Idempotency-Key` of a request, and the request it stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Idempotency {
    /// What the client sent; unique within the tenant as long as the job is kept.
    pub key: String,
    /// Digest of everything else in the request.
    pub request: String,
}

/// What came of adding a job.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Created {
    /// It is new.
    New(Job),
    /// An earlier request with this key added this one; nothing was added.
    Known(Job),
}

/// What a store allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rules {
    /// Jobs that may wait at a time.
    pub max_queued: usize,
    /// Counted attempts after which a job that keeps being released has failed.
    pub max_attempts: u32,
    /// Pause of a job after the first crash that it was worked on in.
    pub crash_pause: Duration,
}

/// Longest pause of a job after a crash, unless [`Rules::crash_pause`] is longer.
const LONGEST_PAUSE: Duration = Duration::from_secs(600);

/// Longest time in which nothing is claimed because of a suspect: before it starts, and from its start on.
pub(super) const ALONE: Duration = Duration::from_secs(30);

/// Crashes after which a suspect is to run alone.
const ALONE_FROM: u32 = 2;

/// Crashes after which the only old suspect is blamed for another one, whatever started after it.
const BLAMED_FROM: u32 = 5;

impl Rules {
    /// The pause of a job after so many crashes that it was worked on in.
    fn pause(&self, crashes: u32) -> Duration {
        let factor = 10u32.saturating_pow(crashes.saturating_sub(1));
        self.crash_pause.saturating_mul(factor).min(LONGEST_PAUSE.max(self.crash_pause))
    }
}

/// What a worker claims.
#[derive(Debug, Clone)]
pub(super) struct Claiming {
    /// At most so many jobs.
    pub limit: usize,
    /// At most so many more, only of tenants without a running job.
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
pub(super) enum Retried {
    /// It waits again.
    Queued(Box<Job>),
    /// It is in another state than failed, and was left as it is.
    NotFailed(State),
    /// There is no such job.
    Unknown,
}

/// Why a running job is given back.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Release {
    /// The attempt failed, and another one may not. It counts if it had begun.
    Failed(Error),
    /// The attempt was broken off without fault; it does not count.
    Free,
}

/// What a store counts since it was opened, for the metrics.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Statistics {
    /// Transactions committed.
    pub commits: u64,
    /// Changes in them: over `commits`, how many share one.
    pub commands: u64,
    /// Transactions that failed.
    pub failures: u64,
    /// Time spent in transactions, in seconds.
    pub commit_seconds: f64,
    /// Attempts that failed because the process ended or their lease was over, with [`Kind::Unavailable`].
    pub attempts_failed: u64,
    /// Jobs that were given up after such an attempt.
    pub given_up: u64,
}

/// How a job ends.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum End {
    /// With a result.
    Succeeded(Summary),
    /// With an error.
    Failed(Error),
    /// Because someone asked for it.
    Cancelled,
}

/// The end of a running job, and what comes with it, in one step.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ending {
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

/// A job as it is now.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Job {
    /// Its name.
    pub id: JobId,
    /// Where it is in its life.
    pub state: State,
    /// What it is.
    pub spec: Spec,
    /// Place among the waiting jobs of its tenant: 1 for the one that is claimed first; none when it does not wait.
    pub queue_position: Option<u64>,
    /// Claims so far; results of others than the last one mean nothing.
    pub attempt: u32,
    /// Name of the process that claimed it last.
    pub worker: Option<String>,
    /// How far it is.
    pub progress: Progress,
    /// Whether someone asked for its end.
    pub cancel_requested: bool,
    /// Why it failed.
    pub problem: Option<Error>,
    /// What it gave.
    pub summary: Option<Summary>,
    /// When it was accepted.
    pub created_at: SystemTime,
    /// When it was claimed.
    pub started_at: Option<SystemTime>,
    /// When it ended.
    pub ended_at: Option<SystemTime>,
}

impl Job {
    /// Whether its upload is kept after its end: that of a job that was given up, which may be run again.
    pub fn keeps_upload(&self) -> bool {
        self.problem.as_ref().is_some_and(|problem| problem.kind == Kind::Poison)
    }
}

/// The right to write about a running job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Ticket {
    /// The job.
    pub job: JobId,
    /// Counts the claims of the job; an older one writes nothing.
    pub attempt: u32,
}

/// Something that happened to a job.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Event {
    /// Its number: 1 for the job's first.
    pub seq: u64,
    /// What happened.
    pub what: What,
}

/// What can happen to a job.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum What {
    /// It entered a state that is no end.
    State(State),
    /// It is running: the number of the attempt, and the worker. Iterations and rounds up to the next state are of this
    /// attempt.
    Started(u32, String),
    /// An iteration was made: the report's row, as JSON text in one line.
    Iteration(String),
    /// A round of a hierarchy was made: the report's row, as JSON text in one line.
    Round(String),
    /// It ended; no event follows, unless it is run again.
    End(State, Option<Error>),
}

/// What wakes those who wait for a job: everything that can change about it, small enough to be compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Pulse {
    /// Number of the last event.
    pub last_seq: u64,
    /// Whether someone asked for the job's end.
    pub cancel_requested: bool,
    /// Whether the job ended.
    pub ended: bool,
}

/// The end of a job that a webhook is to tell. It is kept apart from the job and outlasts it: who was promised to be told
/// is told, also when the job is deleted or forgotten before that.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Notice {
    /// The job.
    pub job: JobId,
    /// Where it is to be told.
    pub webhook: String,
    /// The `traceparent` of the request that the job came with.
    pub trace_parent: Option<String>,
    /// The state that the job ended in.
    pub state: State,
    /// Why it failed.
    pub problem: Option<Error>,
    /// When it ended.
    pub ended_at: SystemTime,
}

/// A page of the list of jobs.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Page {
    /// The jobs, newest first.
    pub jobs: Vec<Job>,
    /// Where the next page begins; none on the last.
    pub next: Option<String>,
}

/// Which part of the list of jobs.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct ListQuery {
    /// Only jobs of this tenant.
    pub tenant: Option<String>,
    /// Only jobs in this state.
    pub state: Option<State>,
    /// Go on where an earlier page ended: its `next`.
    pub cursor: Option<String>,
    /// At most so many jobs.
    pub limit: usize,
}

/// What came of asking to delete a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Deletion {
    /// It is gone.
    Deleted,
    /// It has not ended; it was left as it is.
    Live,
    /// There is no such job.
    Unknown,
}

/// Keeps jobs and their events. See the [module](self) for the life of a job.
#[async_trait]
pub(super) trait JobStore: fmt::Debug + Send + Sync {
    /// Whether jobs outlast the process.
    fn is_durable(&self) -> bool;

    /// [`Kind::QueueFull`] when [`create`](Self::create) would be refused now, so that an upload need not come first.
    async fn check_room(&self) -> Result<()>;

    /// Whether a job of the tenant was added with this key: then [`create`](Self::create) adds none.
    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool>;

    /// Adds a job at the end of the queue. [`Kind::QueueFull`] when as many wait as may; [`Kind::KeyReused`] when its key
    /// stands for another request. When this returns, the job is kept as well as this store keeps anything.
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

    /// When a job that the last claim passed over may be claimed, if that needs no other change.
    fn next_start(&self) -> Option<SystemTime>;

    /// The worker begins to read the mesh: from now on the attempt counts. Small uploads begin with their claim. Nothing
    /// happens when the attempt has begun already.
    async fn begin(&self, ticket: Ticket) -> Result<()>;

    /// Puts a failed job back into the queue, with no attempt counted. Its upload must still be there.
    /// [`Kind::QueueFull`] when as many jobs wait as may.
    async fn retry(&self, id: JobId) -> Result<Retried>;

    /// Prolongs leases; returns the tickets that are over.
    async fn heartbeat(&self, tickets: &[Ticket], until: SystemTime) -> Result<Vec<Ticket>>;

    /// Gives a running job back: it waits again, or has failed ([`Kind::Poison`]) when it was given back too often, or
    /// is cancelled when someone asked for that.
    async fn release(&self, ticket: Ticket, release: Release) -> Result<State>;

    /// Releases the running jobs whose lease is over at `now`; returns the tickets that held them.
    async fn reclaim(&self, now: SystemTime) -> Result<Vec<Ticket>>;

    /// Appends events and replaces the progress.
    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()>;

    /// Ends a running job. Small blobs of its upload go, unless it is given up.
    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()>;

    /// Ends a running job about which nothing else is to be said.
    #[cfg(test)]
    async fn finish(&self, ticket: Ticket, end: End) -> Result<()> {
        self.end(ticket, end.into()).await
    }

    /// Whether blobs of so many bytes together are small, and better kept here than in files.
    fn takes(&self, bytes: u64) -> bool;

    /// A small blob of a job; none when there is no such blob, or job.
    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>>;

    /// Bytes on disk that the store has taken and will use again before it takes more.
    async fn free_bytes(&self) -> Result<u64>;

    /// Asks for the end of a job: a queued one is cancelled at once, a running one when its worker gives in, an ended
    /// one stays as it is. The job after that; none when there is no such job.
    async fn cancel(&self, id: JobId) -> Result<Option<Job>>;

    /// Forgets an ended job, its events and its key. That its end is to be told stays.
    async fn delete(&self, id: JobId) -> Result<Deletion>;

    /// Jobs that ended before a moment, at most `limit`, the longest ended first.
    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>>;

    /// At most `limit` events of a job from number `after + 1` on; none when there is no such job.
    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>>;

    /// Tells of every change of a job until it is deleted; none when there is no such job.
    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>>;

    /// Changes whenever a job may be claimed that could not be before: what a worker without work waits for. Marked as
    /// changed from the start.
    fn arrivals(&self) -> watch::Receiver<u64>;

    /// Changes whenever a job with a webhook ended: what the teller of ends waits for. Marked as changed from the start.
    fn endings(&self) -> watch::Receiver<u64>;

    /// Jobs whose webhook was not settled yet, in the order of their ends, also those that were deleted since. Outlasts
    /// the process where jobs do.
    async fn untold(&self) -> Result<Vec<JobId>>;

    /// What is to be told about one of the [untold](Self::untold); none for another job.
    async fn notice(&self, id: JobId) -> Result<Option<Notice>>;

    /// The webhook of a job was delivered or given up: it is told no more. Nothing happens for an unknown job.
    async fn settle_webhook(&self, id: JobId) -> Result<()>;

    /// Number of jobs of a tenant that wait.
    async fn queued_of(&self, tenant: &str) -> Result<u64>;

    /// Number of jobs in each state, in the order of [`State::ALL`].
    async fn counts(&self) -> Result<[u64; State::ALL.len()]>;

    /// When the job was accepted that waits longest; none when no job waits.
    async fn oldest_queued(&self) -> Result<Option<SystemTime>>;

    /// Writes something of no meaning, to see whether it can.
    async fn probe(&self) -> Result<()>;

    /// What it counts.
    fn statistics(&self) -> Statistics;

    /// Finishes what it was asked for and lets go of its files. Nothing works afterwards.
    async fn close(&self);
}

/// The error of a queue that holds as many jobs as it may.
fn queue_is_full(max_queued: usize) -> Error {
    Error::new(Kind::QueueFull, format_args!("as many jobs wait as may; try again later: {max_queued}"))
}

/// The error of a ticket that is over.
fn not_yours(id: JobId) -> Error {
    Error::new(Kind::Conflict, format_args!("the job is no longer this worker's: {id}"))
}

/// The error of a key that stands for another request.
fn reused_key(key: &str) -> Error {
    Error::new(
        Kind::KeyReused,
        format_args!(
            "another request came with this Idempotency-Key before; send a new key with a new request: {key:?}"
        ),
    )
}

/// Why a job is released whose worker is gone.
fn lease_is_over() -> Error {
    Error::new(Kind::Unavailable, "the service ended, or stood still, while the job ran")
}

/// The error of a job that was given back too often.
fn given_up(attempts: u64, last: &Error) -> Error {
    Error::new(
        Kind::Poison,
        format_args!(
            "the job was given up after {attempts} attempts, of which the last failed: {last}; its upload is kept until the \
             job is deleted: to run it again, POST to its path followed by /retry"
        ),
    )
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Rules of a store in a test.
    pub const RULES: Rules = Rules { max_queued: 100, max_attempts: 3, crash_pause: Duration::ZERO };

    /// A job of the tenant `local` like any other.
    pub fn new_job() -> NewJob {
        let spec = Spec {
            tenant: LOCAL_TENANT.to_owned(),
            trace_parent: None,
            webhook: None,
            parameters: Parameters { clusters: Some(7), ..Parameters::default() },
            file_name: None,
            format: Format::Obj,
            bytes: 100,
            buffers: Vec::new(),
            listed_seeds: false,
            has_weights: false,
            is_small: false,
            priority: 0,
        };
        NewJob { id: JobId::random(), spec, idempotency: None, upload: Vec::new() }
    }
}
