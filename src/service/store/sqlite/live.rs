//! A job that changes: its row as commands need it, and the steps that they share.

use std::time::SystemTime;

use rusqlite::{Connection, Row, params};

use super::super::{
    End, JobId, Progress, Pulse, Release, Rules, SmallBlob, State, Ticket, What, given_up, keeps_upload, lease_is_over,
    no_such_job, not_yours,
};
use super::connections::{Abort, execute, first, one};
use super::rows::{self, column, json, micros};
use super::writer::Batch;
use crate::error::{Error, Result};

/// The row of a job that changes.
pub(super) struct Live {
    pub id: JobId,
    pub number: i64,
    pub last_seq: i64,
    pub cancel_requested: bool,
    pub attempt: u32,
    pub uncounted: u32,
    pub has_begun: bool,
    /// Crashes of the service while a worker had the job.
    pub suspicion: u32,
}

impl Live {
    /// A job that was just added.
    pub fn new(id: JobId, number: i64) -> Self {
        let (last_seq, attempt, uncounted, suspicion) = (0, 0, 0, 0);
        Self { id, number, last_seq, cancel_requested: false, attempt, uncounted, has_begun: false, suspicion }
    }

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

    /// The job of that id with its state, if there is one.
    pub fn find(connection: &Connection, id: JobId) -> Result<Option<(State, Self)>, Abort> {
        let sql = "SELECT number, state, attempt, uncounted, begun, suspicion, last_seq, cancel_requested FROM jobs \
                   WHERE id = ?1";
        first(connection, sql, [id.to_string()], |row| Ok((rows::state(row)?, Self::from_row(id, row)?)))
    }

    /// The running job that a ticket is valid for.
    pub fn claimed(connection: &Connection, ticket: Ticket) -> Result<Self, Abort> {
        let (state, live) = Self::find(connection, ticket.job)?.ok_or_else(|| no_such_job(ticket.job))?;
        match state == State::Running && live.attempt == ticket.attempt {
            true => Ok(live),
            false => Err(not_yours(ticket.job).into()),
        }
    }

    /// Appends events, and wakes their readers. The caller writes `last_seq` to the row.
    pub fn append(&mut self, batch: &mut Batch<'_>, events: &[What]) -> Result<(), Abort> {
        for event in events {
            self.last_seq += 1;
            let (kind, data) = rows::split(event)?;
            let sql = "INSERT INTO events (job, seq, kind, data) VALUES (?1, ?2, ?3, ?4)";
            execute(batch.connection, sql, params![self.number, self.last_seq, kind, data])?;
        }
        self.pulse(batch, false);
        Ok(())
    }

    /// Keeps small blobs of the job.
    pub fn keep(&self, batch: &mut Batch<'_>, blobs: &[SmallBlob]) -> Result<(), Abort> {
        for SmallBlob { name, bytes } in blobs {
            let sql = "INSERT INTO blobs (job, name, bytes) VALUES (?1, ?2, ?3)";
            execute(batch.connection, sql, params![self.number, name, &bytes[..]])?;
        }
        Ok(())
    }

    /// Ends the job, after its last events and the progress after them; small blobs of its upload are removed, unless
    /// it is given up.
    pub fn end(&mut self, batch: &mut Batch<'_>, end: &End, rest: Option<&(Vec<What>, Progress)>) -> Result<(), Abort> {
        let (state, problem, summary) = end.parts();
        if let Some((events, _)) = rest {
            self.append(batch, events)?;
        }
        self.append(batch, &[What::End(state, problem.cloned())])?;
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
            batch.effects.endings = true;
        }
        if has_blobs && !keeps_upload(problem) {
            execute(batch.connection, "DELETE FROM blobs WHERE job = ?1", [self.number])?;
        }
        batch.effects.ends = true;
        self.pulse(batch, true);
        Ok(())
    }

    /// Puts the job back to its place in the queue, or ends it where it must not run again.
    pub fn release(&mut self, batch: &mut Batch<'_>, release: &Release, rules: &Rules) -> Result<State, Abort> {
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
    pub fn abandoned(&mut self, batch: &mut Batch<'_>, rules: &Rules, not_before: SystemTime) -> Result<State, Abort> {
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
    pub fn free(&mut self, batch: &mut Batch<'_>, not_before: SystemTime) -> Result<State, Abort> {
        self.uncounted += 1;
        self.queue(batch, not_before)
    }

    /// Puts the job into the queue, or ends it where that was requested; a suspect waits until `not_before`.
    pub fn queue(&mut self, batch: &mut Batch<'_>, not_before: SystemTime) -> Result<State, Abort> {
        if self.cancel_requested {
            self.end(batch, &End::Cancelled, None)?;
            return Ok(State::Cancelled);
        }
        self.append(batch, &[What::State(State::Queued)])?;
        execute(
            batch.connection,
            "UPDATE jobs SET state = 'queued', lease_until = NULL, uncounted = ?1, suspicion = ?2, not_before = ?3, \
             last_seq = ?4 WHERE number = ?5",
            params![self.uncounted, self.suspicion, micros(not_before), self.last_seq, self.number],
        )?;
        batch.effects.arrivals = true;
        Ok(State::Queued)
    }

    /// Notes a pulse, which the writer publishes after the commit.
    pub fn pulse(&self, batch: &mut Batch<'_>, ended: bool) {
        let last_seq = self.last_seq.unsigned_abs();
        batch.effects.pulses.push((self.id, Pulse { last_seq, cancel_requested: self.cancel_requested, ended }));
    }
}
