//! What changes jobs, as SQL: each command checks, then writes, and says whom to wake.

use std::time::{Duration, SystemTime};

use rusqlite::{Connection, Row, params};

use super::super::{
    Created, Deletion, End, Ending, Job, JobId, NewJob, Progress, Pulse, Release, Rules, SmallBlob, State, Summary,
    Ticket, What, given_up, lease_is_over, no_such_job, not_yours, queue_is_full, reused_key,
};
use super::connections::{Abort, all, execute, first, one};
use super::rows::{self, column, count, jobs, json, micros, text};
use super::writer::{Batch, Command};
use crate::error::{Error, Result};

/// Adds a job.
pub(super) struct Create(pub NewJob, pub Rules);

impl Command for Create {
    type Output = Created;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Created, Abort> {
        let Self(NewJob { id, spec, idempotency, upload }, rules) = self;
        let (key, request) = match idempotency {
            Some(wanted) => (Some(&wanted.key), Some(&wanted.request)),
            None => (None, None),
        };
        if let (Some(key), Some(request)) = (key, request) {
            let sql = jobs!("WHERE tenant = ?1 AND idempotency_key = ?2");
            let known = first(batch.connection, sql, params![spec.tenant, key], |row| {
                match text(row, "request_digest")? == request {
                    true => rows::job(row),
                    false => Err(reused_key(key)),
                }
            });
            if let Some(job) = known? {
                return Ok(Created::Known(job));
            }
        }
        let waiting = waiting(batch.connection)?;
        if waiting >= rules.max_queued as u64 {
            return Err(queue_is_full(rules.max_queued).into());
        }
        let created_at = rows::now();
        let progress = Progress::default();
        execute(
            batch.connection,
            "INSERT INTO jobs (id, tenant, state, spec, progress, idempotency_key, request_digest, created_at, last_seq) \
             VALUES (?1, ?2, 'queued', ?3, ?4, ?5, ?6, ?7, 1)",
            params![id.to_string(), spec.tenant, json(spec)?, json(&progress)?, key, request, micros(created_at)],
        )?;
        let number = batch.connection.last_insert_rowid();
        let mut live = Live { id: *id, number, last_seq: 0, cancel_requested: false, attempt: 0, uncounted: 0 };
        live.keep(batch, upload)?;
        live.tell(batch, &[What::State(State::Queued)])?;
        batch.effects.arrivals += 1;
        Ok(Created::New(Job {
            id: *id,
            state: State::Queued,
            spec: spec.clone(),
            queue_position: Some(waiting + 1),
            attempt: 0,
            progress,
            cancel_requested: false,
            problem: None,
            summary: None,
            created_at,
            started_at: None,
            ended_at: None,
        }))
    }
}

/// Number of jobs that wait.
pub(super) fn waiting(connection: &Connection) -> Result<u64, Abort> {
    one(connection, "SELECT count(*) AS jobs FROM jobs WHERE state = 'queued'", [], |row| count(row, "jobs"))
}

/// Takes jobs from the queue.
pub(super) struct Claim {
    pub limit: usize,
    pub lease: Duration,
}

impl Command for Claim {
    type Output = Vec<(Ticket, Job)>;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let now = rows::now();
        let mut claimed = all(
            batch.connection,
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, started_at = ?1, lease_until = ?2, \
             last_seq = last_seq + 1 WHERE number IN (SELECT number FROM jobs WHERE state = 'queued' ORDER BY number LIMIT ?3) \
             RETURNING *, NULL AS queue_position",
            params![micros(now), micros(now + self.lease), i64::try_from(self.limit).unwrap_or(i64::MAX)],
            |row| {
                let job = rows::job(row)?;
                Ok((Live::from_row(job.id, row)?, job))
            },
        )?;
        claimed.sort_by_key(|(live, _)| live.number);
        for (live, _) in &mut claimed {
            // counted by the statement above
            live.last_seq -= 1;
            live.tell(batch, &[What::State(State::Running)])?;
        }
        Ok(claimed.into_iter().map(|(live, job)| (Ticket { job: job.id, attempt: live.attempt }, job)).collect())
    }
}

/// Prolongs leases; tells which are over.
pub(super) struct Heartbeat {
    pub tickets: Vec<Ticket>,
    pub until: SystemTime,
}

impl Command for Heartbeat {
    type Output = Vec<Ticket>;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let mut lost = Vec::new();
        for ticket in &self.tickets {
            let prolonged = execute(
                batch.connection,
                "UPDATE jobs SET lease_until = ?1 WHERE id = ?2 AND attempt = ?3 AND state = 'running'",
                params![micros(self.until), ticket.job.to_string(), ticket.attempt],
            )?;
            if prolonged == 0 {
                lost.push(*ticket);
            }
        }
        Ok(lost)
    }
}

/// Appends events and replaces the progress.
pub(super) struct Append {
    pub ticket: Ticket,
    pub events: Vec<What>,
    pub progress: Progress,
}

impl Command for Append {
    type Output = ();

    fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        let mut live = claimed(batch.connection, self.ticket)?;
        live.tell(batch, &self.events)?;
        execute(
            batch.connection,
            "UPDATE jobs SET progress = ?1, last_seq = ?2 WHERE number = ?3",
            params![json(&self.progress)?, live.last_seq, live.number],
        )?;
        Ok(())
    }
}

/// Ends a running job.
pub(super) struct Finish(pub Ticket, pub Ending);

impl Command for Finish {
    type Output = ();

    fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        let Self(ticket, Ending { end, rest, result }) = self;
        let mut live = claimed(batch.connection, *ticket)?;
        live.end(batch, end, rest.as_ref())?;
        live.keep(batch, result)
    }
}

/// Gives a running job back.
pub(super) struct GiveBack(pub Ticket, pub Release, pub Rules);

impl Command for GiveBack {
    type Output = State;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<State, Abort> {
        let Self(ticket, release, rules) = self;
        claimed(batch.connection, *ticket)?.release(batch, release, rules)
    }
}

/// Gives back the jobs whose lease ended before a moment.
pub(super) struct Reclaim {
    pub now: SystemTime,
    pub rules: Rules,
}

impl Command for Reclaim {
    type Output = Vec<Ticket>;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let sql = "SELECT * FROM jobs WHERE state = 'running' AND lease_until < ?1 ORDER BY number";
        let found = all(batch.connection, sql, [micros(self.now)], |row| Live::from_row(rows::id(row, "id")?, row))?;
        let mut reclaimed = Vec::new();
        for mut live in found {
            live.release(batch, &Release::Failed(lease_is_over()), &self.rules)?;
            reclaimed.push(Ticket { job: live.id, attempt: live.attempt });
        }
        Ok(reclaimed)
    }
}

/// Asks for the end of a job.
pub(super) struct Cancel(pub JobId);

impl Command for Cancel {
    type Output = Option<Job>;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let read = |row: &Row<'_>| Ok((rows::state(row)?, Live::from_row(self.0, row)?));
        let Some((state, mut live)) = first(batch.connection, LIVE, [self.0.to_string()], read)? else {
            return Ok(None);
        };
        if !state.is_ended() {
            live.cancel_requested = true;
            let sql = "UPDATE jobs SET cancel_requested = 1 WHERE number = ?1";
            execute(batch.connection, sql, [live.number])?;
            match state {
                State::Queued => live.end(batch, &End::Cancelled, None)?,
                _ => live.pulse(batch, false),
            }
        }
        find(batch.connection, self.0)
    }
}

/// Forgets an ended job.
pub(super) struct Delete(pub JobId);

impl Command for Delete {
    type Output = Deletion;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Deletion, Abort> {
        let sql = "SELECT number, state FROM jobs WHERE id = ?1";
        let read = |row: &Row<'_>| Ok((column::<i64>(row, "number")?, rows::state(row)?));
        let Some((number, state)) = first(batch.connection, sql, [self.0.to_string()], read)? else {
            return Ok(Deletion::Unknown);
        };
        if !state.is_ended() {
            return Ok(Deletion::Live);
        }
        for sql in [
            "DELETE FROM events WHERE job = ?1",
            "DELETE FROM blobs WHERE job = ?1",
            "DELETE FROM jobs WHERE number = ?1",
        ] {
            execute(batch.connection, sql, [number])?;
        }
        batch.effects.deleted.push(self.0);
        Ok(Deletion::Deleted)
    }
}

/// The webhook of a job is told no more.
pub(super) struct SettleWebhook(pub JobId);

impl Command for SettleWebhook {
    type Output = ();

    fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        execute(batch.connection, "DELETE FROM notices WHERE job = ?1", [self.0.to_string()])?;
        Ok(())
    }
}

/// Writes something of no meaning.
pub(super) struct Probe;

impl Command for Probe {
    type Output = ();

    fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        let sql = "INSERT OR REPLACE INTO probes (id, at) VALUES (1, ?1)";
        execute(batch.connection, sql, [micros(rows::now())])?;
        Ok(())
    }
}

/// What [`Live`] needs to know of a job, and its state.
const LIVE: &str = "SELECT number, state, attempt, uncounted, last_seq, cancel_requested FROM jobs WHERE id = ?1";

/// The row of a job that has not ended.
struct Live {
    id: JobId,
    number: i64,
    last_seq: i64,
    cancel_requested: bool,
    attempt: u32,
    uncounted: u32,
}

impl Live {
    fn from_row(id: JobId, row: &Row<'_>) -> Result<Self> {
        Ok(Self {
            id,
            number: column(row, "number")?,
            last_seq: column(row, "last_seq")?,
            cancel_requested: column(row, "cancel_requested")?,
            attempt: column(row, "attempt")?,
            uncounted: column(row, "uncounted")?,
        })
    }

    /// Appends events, and wakes those who wait. The row's `last_seq` is for the caller to write.
    fn tell(&mut self, batch: &mut Batch<'_>, events: &[What]) -> Result<(), Abort> {
        for event in events {
            self.last_seq += 1;
            let (kind, data) = rows::split(event)?;
            execute(
                batch.connection,
                "INSERT INTO events (job, seq, kind, data) VALUES (?1, ?2, ?3, ?4)",
                params![self.number, self.last_seq, kind, data],
            )?;
        }
        self.pulse(batch, false);
        Ok(())
    }

    /// Keeps small blobs of the job.
    fn keep(&self, batch: &mut Batch<'_>, blobs: &[SmallBlob]) -> Result<(), Abort> {
        for SmallBlob { name, bytes } in blobs {
            let sql = "INSERT INTO blobs (job, name, bytes) VALUES (?1, ?2, ?3)";
            execute(batch.connection, sql, params![self.number, name, &bytes[..]])?;
        }
        Ok(())
    }

    /// Ends the job, after the last events and the progress after them; small blobs of its upload go.
    fn end(&mut self, batch: &mut Batch<'_>, end: &End, rest: Option<&(Vec<What>, Progress)>) -> Result<(), Abort> {
        let (state, problem, summary): (_, Option<&Error>, Option<&Summary>) = match end {
            End::Succeeded(summary) => (State::Succeeded, None, Some(summary)),
            End::Failed(error) => (State::Failed, Some(error), None),
            End::Cancelled => (State::Cancelled, None, None),
        };
        if let Some((events, _)) = rest {
            self.tell(batch, events)?;
        }
        self.tell(batch, &[What::End(state, problem.cloned())])?;
        let (has_webhook, has_blobs) = one(
            batch.connection,
            "UPDATE jobs SET state = ?1, problem = ?2, summary = ?3, ended_at = ?4, lease_until = NULL, \
             progress = coalesce(?5, progress), last_seq = ?6 WHERE number = ?7 \
             RETURNING spec ->> 'webhook' IS NOT NULL AS has_webhook, coalesce(spec ->> 'is_small', 0) AS has_blobs",
            params![
                state.name(),
                problem.map(json).transpose()?,
                summary.map(json).transpose()?,
                micros(rows::now()),
                rest.map(|(_, progress)| json(progress)).transpose()?,
                self.last_seq,
                self.number
            ],
            |row| Ok((column::<bool>(row, "has_webhook")?, column::<bool>(row, "has_blobs")?)),
        )?;
        if has_webhook {
            execute(
                batch.connection,
                "INSERT INTO notices (job, webhook, trace_parent, state, problem, ended_at) \
                 SELECT id, spec ->> 'webhook', spec ->> 'trace_parent', state, problem, ended_at FROM jobs \
                 WHERE number = ?1",
                [self.number],
            )?;
            batch.effects.endings += 1;
        }
        if has_blobs {
            execute(batch.connection, "DELETE FROM blobs WHERE job = ?1", [self.number])?;
        }
        self.pulse(batch, true);
        Ok(())
    }

    /// Puts the job back where it was in the queue, or ends it where it must not run again.
    fn release(&mut self, batch: &mut Batch<'_>, release: &Release, rules: &Rules) -> Result<State, Abort> {
        if self.cancel_requested {
            self.end(batch, &End::Cancelled, None)?;
            return Ok(State::Cancelled);
        }
        match release {
            Release::Free => self.uncounted += 1,
            Release::Failed(error) => {
                let counted = self.attempt.saturating_sub(self.uncounted);
                if counted >= rules.max_attempts {
                    self.end(batch, &End::Failed(given_up(counted.into(), error)), None)?;
                    return Ok(State::Failed);
                }
            }
        }
        self.tell(batch, &[What::State(State::Queued)])?;
        execute(
            batch.connection,
            "UPDATE jobs SET state = 'queued', lease_until = NULL, uncounted = ?1, last_seq = ?2 WHERE number = ?3",
            params![self.uncounted, self.last_seq, self.number],
        )?;
        batch.effects.arrivals += 1;
        Ok(State::Queued)
    }

    fn pulse(&self, batch: &mut Batch<'_>, ended: bool) {
        let last_seq = self.last_seq.unsigned_abs();
        batch.effects.pulses.push((self.id, Pulse { last_seq, cancel_requested: self.cancel_requested, ended }));
    }
}

/// The job as it is now.
pub(super) fn find(connection: &Connection, id: JobId) -> Result<Option<Job>, Abort> {
    first(connection, jobs!("WHERE id = ?1"), [id.to_string()], rows::job)
}

/// The running job that a ticket is valid for.
fn claimed(connection: &Connection, ticket: Ticket) -> Result<Live, Abort> {
    let read = |row: &Row<'_>| Ok((rows::state(row)?, Live::from_row(ticket.job, row)?));
    let found = first(connection, LIVE, [ticket.job.to_string()], read)?;
    let (state, live) = found.ok_or_else(|| no_such_job(ticket.job))?;
    match state == State::Running && live.attempt == ticket.attempt {
        true => Ok(live),
        false => Err(not_yours(ticket.job).into()),
    }
}
