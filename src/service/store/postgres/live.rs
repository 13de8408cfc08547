//! A job that changes: its row as changes need it, and the steps that they share.
//!
//! Every statement that changes a job names the state and the attempt that it is to have, so it changes nothing when
//! another service was faster. The statement writes the events of the change, too.

use std::time::Duration;

use deadpool_postgres::GenericClient;
use tokio_postgres::Row;
use tokio_postgres::types::Json;
use uuid::Uuid;

use super::super::{
    End, JobId, Progress, Pulse, Release, Rules, SmallBlob, State, Ticket, What, given_up, keeps_upload, lease_is_over,
    no_such_job, not_yours,
};
use super::connections::{Failure, first};
use super::rows::{self, Columns, column, count, small};
use crate::error::Error;

/// What follows from a change once it is committed.
#[derive(Debug, Default)]
pub(super) struct Effects {
    /// A job waits that did not.
    pub arrivals: bool,
    /// A job ended, so that another one of its tenant may start.
    pub ends: bool,
    /// A job with a webhook ended.
    pub endings: bool,
    /// Changes of jobs.
    pub pulses: Vec<(JobId, Pulse)>,
    /// Attempts of lost workers that count, and jobs that were given up after one.
    pub attempts_failed: u64,
    pub given_up: u64,
}

/// The row of a job that changes.
pub(super) struct Live {
    pub id: JobId,
    pub state: State,
    pub attempt: u32,
    pub uncounted: u32,
    pub has_begun: bool,
    /// Workers that were lost while they had begun the job.
    pub suspicion: u32,
    pub cancel_requested: bool,
    pub last_seq: u64,
    /// The worker that claimed it last.
    pub boot: Option<Uuid>,
}

/// Columns of a [`Live`].
macro_rules! live {
    ($rest:literal) => {
        concat!(
            "SELECT jobs.id, jobs.state, jobs.attempt, jobs.uncounted, jobs.begun, jobs.suspicion, \
             jobs.cancel_requested, jobs.last_seq, jobs.boot, jobs.started_at FROM jobs ",
            $rest
        )
    };
}
pub(super) use live;

/// The end of a job that a worker or a client ends.
const END: &str = "WITH job AS (\
    UPDATE jobs SET state = $4, problem = $5, summary = $6, ended_at = clock_timestamp(), lease_until = NULL, \
        reserved_by = NULL, reserved_until = NULL, progress = coalesce($7, progress), ends = ends + 1, \
        last_seq = last_seq + cardinality($8::text[]), cancel_requested = cancel_requested OR $10 \
    WHERE id = $1 AND state = $2 AND attempt = $3 RETURNING *\
), told AS (\
    INSERT INTO events (job, seq, kind, data) \
    SELECT job.number, job.last_seq - cardinality($8::text[]) + e.place, e.kind, e.data \
    FROM job, unnest($8::text[], $9::text[]) WITH ORDINALITY AS e(kind, data, place)\
), noticed AS (\
    INSERT INTO notices (job, webhook, trace_parent, state, problem, ended_at, nth) \
    SELECT id, spec ->> 'webhook', spec ->> 'trace_parent', state, problem, ended_at, ends FROM job \
    WHERE spec ->> 'webhook' IS NOT NULL \
    ON CONFLICT (job) DO UPDATE SET place = DEFAULT, webhook = excluded.webhook, state = excluded.state, \
        problem = excluded.problem, ended_at = excluded.ended_at, nth = excluded.nth, teller = NULL, \
        lease_until = NULL\
), gone AS (\
    DELETE FROM blobs USING job WHERE blobs.job = job.number AND NOT blobs.of_result AND NOT $11\
), kept AS (\
    INSERT INTO blobs (job, of_result, name, bytes) \
    SELECT job.number, true, b.name, b.bytes FROM job, unnest($12::text[], $13::bytea[]) AS b(name, bytes)\
) SELECT last_seq, cancel_requested, spec ->> 'webhook' IS NOT NULL AS has_webhook FROM job";

/// The way of a job back to its place in the queue.
const QUEUE: &str = "WITH job AS (\
    UPDATE jobs SET state = 'queued', problem = NULL, ended_at = NULL, cancel_requested = false, lease_until = NULL, \
        boot = NULL, reserved_by = NULL, reserved_until = NULL, uncounted = $4, suspicion = $5, \
        not_before = clock_timestamp() + make_interval(secs => $6), last_seq = last_seq + 1 \
    WHERE id = $1 AND state = $2 AND attempt = $3 RETURNING number, last_seq\
), told AS (\
    INSERT INTO events (job, seq, kind, data) SELECT number, last_seq, 'state', 'queued' FROM job\
) SELECT last_seq FROM job";

/// How a job ends: what its worker says, and the last events before that.
pub(super) struct LastWords<'e> {
    pub end: &'e End,
    pub rest: Option<&'e (Vec<What>, Progress)>,
    pub result: &'e [SmallBlob],
    /// Whether a client requested the end at the same time.
    pub is_cancel: bool,
}

impl<'e> From<&'e End> for LastWords<'e> {
    fn from(end: &'e End) -> Self {
        Self { end, rest: None, result: &[], is_cancel: false }
    }
}

/// Ends the job with this state and attempt. False when there is none; nothing happens then.
pub(super) async fn end(
    client: &impl GenericClient,
    ticket: Ticket,
    state: State,
    words: LastWords<'_>,
    effects: &mut Effects,
) -> Result<bool, Failure> {
    let (ended, problem, summary) = words.end.parts();
    let last = What::End(ended, problem.cloned());
    let events = Columns::of(words.rest.iter().flat_map(|(events, _)| events).chain([&last]))?;
    let keeps_upload = keeps_upload(problem);
    let names: Vec<&str> = words.result.iter().map(|blob| blob.name.as_str()).collect();
    let bytes: Vec<&[u8]> = words.result.iter().map(|blob| &blob.bytes[..]).collect();
    let row = first(
        client,
        END,
        &[
            &ticket.job.uuid(),
            &state.name(),
            &(ticket.attempt as i32),
            &ended.name(),
            &problem.map(Json),
            &summary.map(Json),
            &words.rest.map(|(_, progress)| Json(progress)),
            &events.kinds,
            &events.data,
            &words.is_cancel,
            &keeps_upload,
            &names,
            &bytes,
        ],
    )
    .await?;
    let Some(row) = row else { return Ok(false) };
    let pulse =
        Pulse { last_seq: count(&row, "last_seq")?, cancel_requested: column(&row, "cancel_requested")?, ended: true };
    effects.ends = true;
    effects.endings |= column::<bool>(&row, "has_webhook")?;
    effects.pulses.push((ticket.job, pulse));
    Ok(true)
}

impl Live {
    /// From a row that [`live!`] selected.
    pub fn from_row(row: &Row) -> Result<Self, Failure> {
        Ok(Self {
            id: rows::id(row, "id")?,
            state: rows::state(row)?,
            attempt: small(row, "attempt")?,
            uncounted: small(row, "uncounted")?,
            has_begun: column(row, "begun")?,
            suspicion: small(row, "suspicion")?,
            cancel_requested: column(row, "cancel_requested")?,
            last_seq: count(row, "last_seq")?,
            boot: column(row, "boot")?,
        })
    }

    /// The job of that id, if there is one; locked in a transaction.
    pub async fn find(client: &impl GenericClient, id: JobId) -> Result<Option<Self>, Failure> {
        let row = first(client, live!("WHERE id = $1 FOR UPDATE"), &[&id.uuid()]).await?;
        row.as_ref().map(Self::from_row).transpose()
    }

    /// The running job that a ticket is valid for.
    pub async fn claimed(client: &impl GenericClient, ticket: Ticket) -> Result<Self, Failure> {
        let live = Self::find(client, ticket.job).await?.ok_or_else(|| no_such_job(ticket.job))?;
        match live.state == State::Running && live.attempt == ticket.attempt {
            true => Ok(live),
            false => Err(not_yours(ticket.job).into()),
        }
    }

    pub fn ticket(&self) -> Ticket {
        Ticket { job: self.id, attempt: self.attempt }
    }

    /// Ends the job.
    pub async fn end(
        &self,
        client: &impl GenericClient,
        words: LastWords<'_>,
        effects: &mut Effects,
    ) -> Result<(), Failure> {
        match end(client, self.ticket(), self.state, words, effects).await? {
            true => Ok(()),
            false => Err(not_yours(self.id).into()),
        }
    }

    /// Puts the job back to its place in the queue, or ends it where it must not run again.
    pub async fn release(
        mut self,
        client: &impl GenericClient,
        release: &Release,
        rules: &Rules,
        effects: &mut Effects,
    ) -> Result<State, Failure> {
        match release {
            Release::Failed(error) if self.has_begun => {
                self.failed(client, error, rules, Duration::ZERO, effects).await
            }
            Release::Failed(_) | Release::Free => self.free(client, Duration::ZERO, effects).await,
        }
    }

    /// The worker was lost with the job; `is_guilty` when the attempt counts.
    pub async fn crashed(
        mut self,
        client: &impl GenericClient,
        is_guilty: bool,
        rules: &Rules,
        effects: &mut Effects,
    ) -> Result<State, Failure> {
        if self.has_begun {
            self.suspicion += 1;
        }
        let pause = if self.has_begun { rules.pause(self.suspicion) } else { Duration::ZERO };
        match is_guilty {
            true => self.abandoned(client, rules, pause, effects).await,
            false => self.free(client, pause, effects).await,
        }
    }

    /// The attempt counts. Its worker is gone, so the store counts it for the metrics.
    pub async fn abandoned(
        mut self,
        client: &impl GenericClient,
        rules: &Rules,
        pause: Duration,
        effects: &mut Effects,
    ) -> Result<State, Failure> {
        let state = self.failed(client, &lease_is_over(), rules, pause, effects).await?;
        effects.attempts_failed += 1;
        effects.given_up += u64::from(state == State::Failed);
        Ok(state)
    }

    /// The attempt counts.
    async fn failed(
        &mut self,
        client: &impl GenericClient,
        error: &Error,
        rules: &Rules,
        pause: Duration,
        effects: &mut Effects,
    ) -> Result<State, Failure> {
        let counted = self.attempt.saturating_sub(self.uncounted);
        if counted >= rules.max_attempts && !self.cancel_requested {
            let end = End::Failed(given_up(counted.into(), error));
            self.end(client, LastWords::from(&end), effects).await?;
            return Ok(State::Failed);
        }
        self.queue(client, pause, effects).await
    }

    /// The attempt does not count.
    pub async fn free(
        &mut self,
        client: &impl GenericClient,
        pause: Duration,
        effects: &mut Effects,
    ) -> Result<State, Failure> {
        self.uncounted += 1;
        self.queue(client, pause, effects).await
    }

    /// Puts the job into the queue, or ends it where that was requested; a suspect waits for the pause.
    pub async fn queue(
        &self,
        client: &impl GenericClient,
        pause: Duration,
        effects: &mut Effects,
    ) -> Result<State, Failure> {
        if self.cancel_requested {
            self.end(client, LastWords::from(&End::Cancelled), effects).await?;
            return Ok(State::Cancelled);
        }
        let (attempt, uncounted) = (self.attempt as i32, self.uncounted as i32);
        let row = first(
            client,
            QUEUE,
            &[
                &self.id.uuid(),
                &self.state.name(),
                &attempt,
                &uncounted,
                &(self.suspicion as i32),
                &pause.as_secs_f64(),
            ],
        )
        .await?;
        let row = row.ok_or_else(|| not_yours(self.id))?;
        let pulse = Pulse { last_seq: count(&row, "last_seq")?, ..Pulse::default() };
        effects.pulses.push((self.id, pulse));
        effects.arrivals = true;
        Ok(State::Queued)
    }
}
