//! Events of jobs, numbered.

use std::fmt;

use async_trait::async_trait;
use tokio::sync::watch;

use super::job::{JobId, Progress, State, Ticket};
use crate::error::{Error, Result};

/// Something that happened to a job.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) struct Event {
    /// Its number: 1 for the job's first.
    pub seq: u64,
    /// What happened.
    pub what: What,
}

/// What can happen to a job.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) enum What {
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

/// What can change about a job, in short: tasks that wait for a job receive it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::service) struct Pulse {
    /// Number of the last event.
    pub last_seq: u64,
    /// Whether the job is to be cancelled.
    pub cancel_requested: bool,
    /// Whether the job ended.
    pub ended: bool,
}

/// Keeps the events of jobs and wakes their readers.
#[async_trait]
pub(in crate::service) trait Events: fmt::Debug + Send + Sync {
    /// Appends events and replaces the progress.
    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()>;

    /// At most `limit` events of a job from number `after + 1` on; none when there is no such job.
    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>>;

    /// A receiver of every change of a job until it is deleted; none when there is no such job.
    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>>;
}
