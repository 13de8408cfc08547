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
use crate::error::{Error, Kind, Result};

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
        check_queue(batch.connection, rules)?;
        let (created_at, urgency) = (rows::now(), -i64::from(spec.priority));
        let progress = Progress::default();
        execute(
            batch.connection,
            "INSERT INTO jobs (id, tenant, state, spec, progress, idempotency_key, request_digest, created_at, urgency, \
             last_seq) VALUES (?1, ?2, 'queued', ?3, ?4, ?5, ?6, ?7, ?8, 1)",
            params![
                id.to_string(),
                spec.tenant,
                json(spec)?,
                json(&progress)?,
                key,
                request,
                micros(created_at),
                urgency
            ],
        )?;
        let number = batch.connection.last_insert_rowid();
        let sql = "SELECT count(*) AS jobs FROM jobs WHERE state = 'queued' AND tenant = ?1 \
                   AND (urgency, number) <= (?2, ?3)";
        let place = one(batch.connection, sql, params![spec.tenant, urgency, number], |row| count(row, "jobs"))?;
        let mut live = Live {
            id: *id,
            number,
            last_seq: 0,
            cancel_requested: false,
            attempt: 0,
            uncounted: 0,
            has_begun: false,
            suspicion: 0,
        };
        live.keep(batch, upload)?;
        live.tell(batch, &[What::State(State::Queued)])?;
        batch.effects.arrivals += 1;
        Ok(Created::New(Job {
            id: *id,
            state: State::Queued,
            spec: spec.clone(),
            queue_position: Some(place),
            attempt: 0,
            worker: None,
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

/// [`Kind::QueueFull`] when as many jobs wait as may.
pub(super) fn check_queue(connection: &Connection, rules: &Rules) -> Result<(), Abort> {
    let sql = "SELECT coalesce(sum(queued), 0) AS jobs FROM tenants";
    match one(connection, sql, [], |row| count(row, "jobs"))? < rules.max_queued as u64 {
        true => Ok(()),
        false => Err(queue_is_full(rules.max_queued).into()),
    }
}

/// Prolongs leases; tells which are over.
pub(super) struct Heartbeat {
    pub tickets: Vec<Ticket>,
    /// Time from now to the end of the leases.
    pub lease: Duration,
}

impl Command for Heartbeat {
    type Output = Vec<Ticket>;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let until = micros(rows::now() + self.lease);
        let mut lost = Vec::new();
        for ticket in &self.tickets {
            let prolonged = execute(
                batch.connection,
                "UPDATE jobs SET lease_until = ?1 WHERE id = ?2 AND attempt = ?3 AND state = 'running'",
                params![until, ticket.job.to_string(), ticket.attempt],
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
pub(super) struct Reclaim(pub Rules);

impl Command for Reclaim {
    type Output = Vec<Ticket>;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let sql = "SELECT * FROM jobs WHERE state = 'running' AND lease_until <= ?1 ORDER BY number";
        let found = all(batch.connection, sql, [micros(rows::now())], |row| Live::from_row(rows::id(row, "id")?, row))?;
        let mut reclaimed = Vec::new();
        for mut live in found {
            match live.has_begun {
                true => live.abandoned(batch, &self.0, rows::now())?,
                false => live.free(batch, rows::now())?,
            };
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

/// The end of a job at a moment is told no more.
pub(super) struct SettleWebhook(pub JobId, pub SystemTime);

impl Command for SettleWebhook {
    type Output = ();

    fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        let sql = "DELETE FROM notices WHERE job = ?1 AND ended_at = ?2";
        execute(batch.connection, sql, params![self.0.to_string(), micros(self.1)])?;
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
pub(super) const LIVE: &str = "SELECT number, state, attempt, uncounted, begun, suspicion, last_seq, cancel_requested FROM jobs \
                    WHERE id = ?1";

/// The row of a job that changes.
pub(super) struct Live {
    pub id: JobId,
    pub number: i64,
    pub last_seq: i64,
    pub cancel_requested: bool,
    pub attempt: u32,
    pub uncounted: u32,
    pub has_begun: bool,
    /// Crashes of the service while it was worked on.
    pub suspicion: u32,
}

impl Live {
    pub fn from_row(id: JobId, row: &Row<'_>) -> Result<Self> {
        Ok(Self {
            id,
            number: column(row, "number")?,
            last_seq: column(row, "last_seq")?,
            cancel_requested: column(row, "cancel_requested")?,
            attempt: column(row, "attempt")?,
            uncounted: column(row, "uncounted")?,
            has_begun: column(row, "begun")?,
            suspicion: column(row, "suspicion")?,
        })
    }

    /// Appends events, and wakes those who wait. The row's `last_seq` is for the caller to write.
    pub fn tell(&mut self, batch: &mut Batch<'_>, events: &[What]) -> Result<(), Abort> {
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
                "INSERT OR REPLACE INTO notices (job, webhook, trace_parent, state, problem, ended_at, nth) \
                 SELECT id, spec ->> 'webhook', spec ->> 'trace_parent', state, problem, ended_at, \
                 (SELECT count(*) FROM events WHERE job = number AND kind = 'end') FROM jobs WHERE number = ?1",
                [self.number],
            )?;
            batch.effects.endings += 1;
        }
        let is_given_up = problem.is_some_and(|problem| problem.kind == Kind::Poison);
        if has_blobs && !is_given_up {
            execute(batch.connection, "DELETE FROM blobs WHERE job = ?1", [self.number])?;
        }
        batch.effects.ends += 1;
        self.pulse(batch, true);
        Ok(())
    }

    /// Puts the job back where it was in the queue, or ends it where it must not run again.
    fn release(&mut self, batch: &mut Batch<'_>, release: &Release, rules: &Rules) -> Result<State, Abort> {
        match release {
            Release::Failed(error) if self.has_begun => self.failed(batch, error, rules, rows::now()),
            Release::Failed(_) | Release::Free => self.free(batch, rows::now()),
        }
    }

    /// The process died while the job ran; `is_guilty` when the attempt counts.
    pub fn crashed(
        &mut self,
        batch: &mut Batch<'_>,
        is_guilty: bool,
        now: SystemTime,
        rules: &Rules,
    ) -> Result<State, Abort> {
        if self.has_begun {
            self.suspicion += 1;
        }
        let not_before = now + rules.pause(self.suspicion);
        match is_guilty {
            true => self.abandoned(batch, rules, not_before),
            false => self.free(batch, not_before),
        }
    }

    /// The attempt counts. Its worker is gone, so the store counts it for the metrics.
    fn abandoned(&mut self, batch: &mut Batch<'_>, rules: &Rules, not_before: SystemTime) -> Result<State, Abort> {
        let state = self.failed(batch, &lease_is_over(), rules, not_before)?;
        batch.effects.attempts_failed += 1;
        batch.effects.given_up += u64::from(state == State::Failed);
        Ok(state)
    }

    /// The attempt counts.
    fn failed(
        &mut self,
        batch: &mut Batch<'_>,
        error: &Error,
        rules: &Rules,
        not_before: SystemTime,
    ) -> Result<State, Abort> {
        let counted = self.attempt.saturating_sub(self.uncounted);
        if counted >= rules.max_attempts && !self.cancel_requested {
            self.end(batch, &End::Failed(given_up(counted.into(), error)), None)?;
            return Ok(State::Failed);
        }
        self.queue(batch, not_before)
    }

    /// The attempt does not count.
    fn free(&mut self, batch: &mut Batch<'_>, not_before: SystemTime) -> Result<State, Abort> {
        self.uncounted += 1;
        self.queue(batch, not_before)
    }

    /// Lets the job wait, unless its end was asked for; a suspect until a moment at least.
    pub fn queue(&mut self, batch: &mut Batch<'_>, not_before: SystemTime) -> Result<State, Abort> {
        if self.cancel_requested {
            self.end(batch, &End::Cancelled, None)?;
            return Ok(State::Cancelled);
        }
        self.tell(batch, &[What::State(State::Queued)])?;
        execute(
            batch.connection,
            "UPDATE jobs SET state = 'queued', lease_until = NULL, uncounted = ?1, suspicion = ?2, not_before = ?3, \
             last_seq = ?4 WHERE number = ?5",
            params![self.uncounted, self.suspicion, micros(not_before), self.last_seq, self.number],
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
pub(super) fn claimed(connection: &Connection, ticket: Ticket) -> Result<Live, Abort> {
    let read = |row: &Row<'_>| Ok((rows::state(row)?, Live::from_row(ticket.job, row)?));
    let found = first(connection, LIVE, [ticket.job.to_string()], read)?;
    let (state, live) = found.ok_or_else(|| no_such_job(ticket.job))?;
    match state == State::Running && live.attempt == ticket.attempt {
        true => Ok(live),
        false => Err(not_yours(ticket.job).into()),
    }
}
