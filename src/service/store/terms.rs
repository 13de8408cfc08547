//! What users of the store ask it for, and what they get.

use std::time::SystemTime;

use tesserae_mesh::error::{Error, Result};

use super::database::{Row, json, read, unreadable};
use super::job::{Job, JobId, Progress, SmallBlob, Spec, Summary};
use crate::queue::{JobEvent, State};

#[derive(Debug, Clone)]
pub(crate) struct NewJob {
    pub id: JobId,
    pub spec: Spec,
    pub idempotency: Option<Idempotency>,
    /// Small blobs of its upload, kept until it ends, and beyond that when it is [given up](Job::keeps_upload).
    pub upload: Vec<SmallBlob>,
    /// Jobs of its tenant that may wait; any number when none.
    pub most_waiting: Option<u64>,
}

/// The `Idempotency-Key` of a request, and the request it stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Idempotency {
    /// What the client sent; unique within the tenant as long as the job is kept.
    pub key: String,
    /// Digest of everything else in the request.
    pub request: String,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Created {
    New(Job),
    /// An earlier request with this key added this one; nothing was added.
    Known(Job),
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum End {
    Succeeded(Summary),
    Failed(Error),
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
pub(crate) struct Ending {
    pub end: End,
    /// The last events before that, and the progress after them.
    pub rest: Option<(Vec<JobEvent>, Progress)>,
    pub result: Vec<SmallBlob>,
}

impl From<End> for Ending {
    fn from(end: End) -> Self {
        Self { end, rest: None, result: Vec::new() }
    }
}

#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Page {
    pub jobs: Vec<Job>,
    /// Where the next page begins; none on the last.
    pub next: Option<String>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ListQuery {
    pub tenant: String,
    pub state: Option<State>,
    /// Go on where an earlier page ended: its `next`.
    pub cursor: Option<String>,
    pub limit: usize,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Event {
    pub seq: u64,
    pub what: JobEvent,
}

impl JobEvent {
    pub(super) fn columns(&self) -> Result<(&'static str, String)> {
        Ok(match self {
            Self::Queued => ("state", State::Queued.name().to_owned()),
            Self::Started(attempt, worker) => ("started", json(&(attempt, worker))?),
            Self::Iteration(row) => ("iteration", row.clone()),
            Self::Round(row) => ("round", row.clone()),
            Self::End(state, problem) => ("end", json(&(state, problem))?),
        })
    }
}

impl Event {
    pub(super) fn of(row: &Row) -> Result<Self> {
        let what = match &*row.get::<String>("kind")? {
            "state" => JobEvent::Queued,
            "started" => row.json("data").map(|(attempt, worker)| JobEvent::Started(attempt, worker))?,
            "iteration" => JobEvent::Iteration(row.get("data")?),
            "round" => JobEvent::Round(row.get("data")?),
            "end" => row.json("data").map(|(state, problem)| JobEvent::End(state, problem))?,
            other => return Err(unreadable("kind", &other)),
        };
        Ok(Self { seq: row.get("seq")?, what })
    }
}

impl Pulse {
    pub(super) fn of(row: &Row) -> Result<Self> {
        let ended = row.get::<State>("state")?.is_ended();
        Ok(Self { last_seq: row.get("last_seq")?, cancel_requested: row.get("cancel_requested")?, ended })
    }
}

impl Notice {
    pub(super) fn of(row: &Row) -> Result<Self> {
        Ok(read!(row, Self {
            job, webhook, trace_parent, state, ended_at;
            problem: row.json("problem")?,
            end: row.get("nth")?,
        }))
    }
}

/// What tasks that wait for a job receive. The later one is larger: a job ends and begins anew by an event.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Pulse {
    pub last_seq: u64,
    pub cancel_requested: bool,
    pub ended: bool,
}

/// The end of a job whose webhook is to be sent, even if the job is deleted first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Notice {
    pub job: JobId,
    pub webhook: String,
    pub trace_parent: Option<String>,
    pub state: State,
    pub problem: Option<Error>,
    pub ended_at: SystemTime,
    /// Number of this end: 1, or more for a job that was retried.
    pub end: u32,
}

/// What a store counts since it was opened, for the metrics.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Statistics {
    pub commits: u64,
    /// Changes in them: over `commits`, how many share one.
    pub commands: u64,
    pub failures: u64,
    pub commit_seconds: f64,
    /// Attempts that failed because the process ended or their lease was over.
    pub attempts_failed: u64,
    /// Jobs that were given up after such an attempt.
    pub given_up: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Deletion {
    Deleted,
    /// It has not ended; it was left as it is.
    Live,
    Unknown,
}
