//! A job as the rules see it, its changes, and what the operator allows.

use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};
use tesserae_mesh::error::{Error, Kind, Result};
use utoipa::ToSchema;

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum State {
    /// Accepted; waits for its turn.
    #[default]
    Queued,
    /// Being read, clustered or written.
    Running,
    /// Ended; labels and report are there.
    Succeeded,
    /// Ended; `problem` says why.
    Failed,
    /// Ended on request.
    Cancelled,
}

impl State {
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
        !matches!(self, State::Queued | State::Running)
    }
}

/// What the rules know of a job: columns of its row. The default is a new one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Standing {
    pub state: State,
    /// Whether its upload is small: an attempt then begins with its claim.
    pub is_small: bool,
    /// Claims so far: the fence of every write by a worker.
    pub attempt: u32,
    /// Of them, those that do not count: broken off without fault, or before the last retry.
    pub uncounted: u32,
    /// Whether the reading of the mesh began in the current attempt.
    pub has_begun: bool,
    /// Crashes of workers while the job had begun; a job with any is a suspect.
    pub suspicion: u32,
    /// When a waiting job that is a suspect may start.
    pub not_before: Option<SystemTime>,
    pub started_at: Option<SystemTime>,
    pub lease_until: Option<SystemTime>,
    pub cancel_requested: bool,
}

/// What happens to a job. Of a worker, the first number is that of its attempt.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Change {
    /// A worker claims it, for that long.
    Claim(Arc<str>, Duration),
    /// The worker begins to read the mesh: from now on the attempt counts. Nothing happens when it has begun already.
    Begin(u32),
    /// The worker is alive: its lease ends this long after now.
    Heartbeat(u32, Duration),
    /// The worker gives it back. With a fault, the attempt failed, and another one may not; it counts if it had begun.
    /// Without, it was broken off without fault, and does not count.
    Release {
        attempt: u32,
        fault: Option<Error>,
    },
    /// The worker ends it in that state, with the problem of a failed job.
    End {
        attempt: u32,
        state: State,
        problem: Option<Error>,
    },
    /// Its lease is over, but the worker is alive: it stood still.
    LeaseOver,
    /// The worker crashed, and whether that counts: see [`crashed`].
    Crashed {
        counts: bool,
    },
    /// A client requests its end: a waiting job ends at once, a running one when its worker stops, an ended one stays.
    Cancel,
    Retry,
}

/// What an event of a job says. Every change of the state is one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum JobEvent {
    Queued,
    /// It runs: the number of the attempt, which also made the iterations and rounds up to the next state; the worker.
    Started(u32, String),
    /// An iteration was made: the report's row, as JSON text in one line.
    Iteration(String),
    /// A round of a hierarchy was made: the report's row, as JSON text in one line.
    Round(String),
    /// It ended, with the problem of a failed job; no event follows, unless it is run again.
    End(State, Option<Error>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rules {
    pub max_queued: usize,
    /// Counted attempts after which a job that keeps being given back has failed.
    pub max_attempts: u32,
    /// Pause of a suspect after each crash, so that a supervisor does not take crashes for a service that cannot start.
    pub crash_pause: Duration,
}

impl Rules {
    /// [`Kind::QueueFull`] when as many jobs wait as may, or `most` of the tenant.
    pub fn check_room(&self, waiting: u64, own: u64, most: Option<u64>) -> Result<()> {
        let full = |whose: &str, most: u64| {
            Err(Error::new(Kind::QueueFull, format_args!("as many jobs{whose} wait as may; try again later: {most}")))
        };
        match most {
            _ if waiting >= self.max_queued as u64 => full("", self.max_queued as u64),
            Some(most) if own >= most => full(" of this tenant", most),
            _ => Ok(()),
        }
    }
}

impl Standing {
    /// The job after a change, and the event if the state changed; the state where the change is not allowed.
    pub fn apply(self, change: Change, rules: &Rules, now: SystemTime) -> Result<(Self, Option<JobEvent>), State> {
        if !self.allows(&change) {
            return Err(self.state);
        }
        Ok(match change {
            Change::Claim(worker, lease) => {
                let attempt = self.attempt + 1;
                let claimed = Self {
                    state: State::Running,
                    attempt,
                    has_begun: self.is_small,
                    not_before: None,
                    started_at: Some(now),
                    lease_until: Some(now + lease),
                    ..self
                };
                (claimed, Some(JobEvent::Started(attempt, worker.to_string())))
            }
            Change::Begin(_) => (Self { has_begun: true, ..self }, None),
            Change::Heartbeat(_, lease) => (Self { lease_until: Some(now + lease), ..self }, None),
            Change::Release { fault, .. } => self.given_back(fault, rules, now),
            Change::End { state, problem, .. } => self.ended(state, problem),
            Change::LeaseOver => self.given_back(Some(lease_is_over()), rules, now),
            Change::Crashed { counts } => {
                let suspicion = self.suspicion.saturating_add(self.has_begun.into());
                Self { suspicion, ..self }.given_back(counts.then(lease_is_over), rules, now + rules.crash_pause)
            }
            Change::Cancel if self.state.is_ended() => (self, None),
            Change::Cancel if self.state == State::Queued => {
                Self { cancel_requested: true, ..self }.ended(State::Cancelled, None)
            }
            Change::Cancel => (Self { cancel_requested: true, ..self }, None),
            Change::Retry => {
                // no attempt is counted; a suspect still starts alone, as after one crash
                let suspicion = self.suspicion.min(1);
                Self { uncounted: self.attempt, suspicion, cancel_requested: false, ..self }.queued(now)
            }
        })
    }

    /// Whether the state allows a change, and no earlier attempt names it.
    fn allows(&self, change: &Change) -> bool {
        match change {
            Change::Claim(..) => self.state == State::Queued,
            Change::Begin(attempt)
            | Change::Heartbeat(attempt, _)
            | Change::Release { attempt, .. }
            | Change::End { attempt, .. } => self.state == State::Running && self.attempt == *attempt,
            Change::LeaseOver | Change::Crashed { .. } => self.state == State::Running,
            Change::Cancel => true,
            Change::Retry => self.state == State::Failed,
        }
    }

    /// Puts the job back to its place in the queue, or ends it where that was requested, or where as many attempts
    /// failed as may. A fault counts if the attempt had begun: before that, the mesh cannot be its cause.
    fn given_back(mut self, fault: Option<Error>, rules: &Rules, not_before: SystemTime) -> (Self, Option<JobEvent>) {
        let fault = fault.filter(|_| self.has_begun);
        if fault.is_none() {
            self.uncounted += 1;
        }
        let counted = self.attempt.saturating_sub(self.uncounted);
        match fault {
            _ if self.cancel_requested => self.ended(State::Cancelled, None),
            Some(error) if counted >= rules.max_attempts => self.ended(State::Failed, Some(given_up(counted, &error))),
            _ => self.queued(not_before),
        }
    }

    fn queued(self, not_before: SystemTime) -> (Self, Option<JobEvent>) {
        let not_before = (self.suspicion > 0).then_some(not_before);
        (Self { state: State::Queued, has_begun: false, not_before, lease_until: None, ..self }, Some(JobEvent::Queued))
    }

    fn ended(self, state: State, problem: Option<Error>) -> (Self, Option<JobEvent>) {
        (Self { state, not_before: None, lease_until: None, ..self }, Some(JobEvent::End(state, problem)))
    }
}

/// The changes of the jobs of a worker that crashed. It counts only if one job had begun: the one possible cause.
pub(crate) fn crashed(jobs: &[Standing]) -> Vec<Change> {
    let begun = jobs.iter().filter(|job| job.has_begun).count();
    jobs.iter().map(|job| Change::Crashed { counts: job.has_begun && begun == 1 }).collect()
}

fn given_up(attempts: u32, last: &Error) -> Error {
    let message = format_args!(
        "the job was given up after {attempts} attempt{}, of which the last failed: {last}; its upload is kept until \
         the job is deleted: to run it again, POST to its path followed by /retry",
        if attempts == 1 { "" } else { "s" }
    );
    Error::new(Kind::Poison, message)
}

fn lease_is_over() -> Error {
    Error::unavailable("the service ended, or stood still, while the job ran")
}

pub(crate) fn not_yours(job: impl Display) -> Error {
    Error::conflict(format_args!("the job is no longer this worker's: {job}"))
}
