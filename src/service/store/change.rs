//! A change of jobs: its transaction, rows and events. [`queue`](crate::queue) says what it makes of a job.

use std::time::SystemTime;

use serde::Deserialize;
use tesserae_mesh::error::{Error, Result};
use uuid::Uuid;

use super::database::{Abort, Row, Rows, Value, json, read, values};
use super::job::{Job, JobId, SmallBlob, Ticket, keeps_upload};
use super::listeners::Effects;
use super::terms::{Ending, Pulse};
use crate::queue::{Change, JobEvent, Rules, Standing, State, not_yours};

pub struct Transaction<'t> {
    pub rows: &'t mut dyn Rows,
    pub effects: &'t mut Effects,
    pub rules: Rules,
    pub me: Uuid,
    /// The time of the change, once it was read: that of all its jobs.
    pub now: Option<SystemTime>,
}

/// A `SELECT` for [`job`]: all columns, and the place in the tenant's queue.
macro_rules! jobs {
    ($($rest:literal)+) => {
        concat!(
            "SELECT *, CASE state WHEN 'queued' THEN (SELECT count(*) FROM jobs AS before \
             WHERE before.state = 'queued' AND before.tenant = jobs.tenant \
             AND (before.urgency, before.number) <= (jobs.urgency, jobs.number)) END AS queue_position FROM jobs ",
            $($rest),+
        )
    };
}
pub(in crate::store) use jobs;

/// A job, from a row of all columns and `queue_position`.
pub fn job(row: &Row) -> Result<Job> {
    Ok(read!(row, Job {
        id, state, queue_position, attempt, worker, cancel_requested, created_at, started_at, ended_at;
        spec: row.json("spec")?,
        progress: row.json("progress")?,
        problem: row.json("problem")?,
        summary: row.json("summary")?,
    }))
}

pub fn standing(row: &Row) -> Result<Standing> {
    Ok(read!(row, Standing {
        state, is_small, attempt, uncounted, suspicion, not_before, started_at, lease_until, cancel_requested;
        has_begun: row.get("begun")?,
    }))
}

const SAVE: &str = "UPDATE jobs SET state = $2, attempt = $3, uncounted = $4, begun = $5, suspicion = $6, \
    not_before = $7, started_at = $8, lease_until = $9, cancel_requested = $10, worker = $11, worker_id = $12, \
    last_seq = $13, ends = $14, problem = $15, summary = $16, ended_at = $17, progress = coalesce($18, progress) \
    WHERE number = $1";

pub struct LiveJob {
    pub id: JobId,
    pub number: i64,
    pub tenant: String,
    pub standing: Standing,
    pub last_seq: u64,
    pub worker: Option<String>,
    pub worker_id: Option<Uuid>,
    /// The URL that its end is sent to, and the `traceparent` for that.
    pub webhook: Option<(String, Option<String>)>,
    pub ends: u32,
}

/// What the end of a job needs of its [spec](super::job::Spec), which a later release may have written.
#[derive(Deserialize)]
struct Traced {
    trace_parent: Option<String>,
}

impl LiveJob {
    pub fn of(row: &Row) -> Result<Self> {
        let webhook = |webhook| (webhook, row.json::<Traced>("spec").ok().and_then(|spec| spec.trace_parent));
        Ok(read!(row, Self {
            id, number, tenant, last_seq, worker, worker_id, ends;
            standing: standing(row)?,
            webhook: row.get::<Option<String>>("webhook")?.map(webhook),
        }))
    }

    pub fn ticket(&self) -> Ticket {
        Ticket { job: self.id, attempt: self.standing.attempt }
    }
}

impl Transaction<'_> {
    /// Now by the clock of the store: one moment for all that the change does.
    pub fn now(&mut self) -> Result<SystemTime, Abort> {
        let now = self.now.map_or_else(|| self.rows.now(), Ok)?;
        Ok(*self.now.insert(now))
    }

    /// The job of that id, locked.
    pub fn find(&mut self, id: JobId) -> Result<Option<LiveJob>, Abort> {
        let sql = "SELECT * FROM jobs WHERE id = $1 FOR UPDATE";
        Ok(self.rows.first(sql, values![id])?.as_ref().map(LiveJob::of).transpose()?)
    }

    /// The job after a change, or [`Kind::Conflict`](tesserae_mesh::Kind::Conflict) where the rules do not allow it.
    pub fn apply(&mut self, mut live: LiveJob, change: Change, ending: Option<&Ending>) -> Result<LiveJob, Abort> {
        let now = self.now()?;
        let before = live.standing;
        let is_fault = match change {
            Change::LeaseOver => before.has_begun,
            Change::Crashed { counts } => counts,
            _ => false,
        };
        let (standing, event) = before.apply(change, &self.rules, now).map_err(|_| not_yours(live.id))?;
        if standing == before && event.is_none() {
            return Ok(live);
        }
        live.standing = standing;
        if is_fault {
            self.effects.attempts_failed += 1;
            self.effects.given_up += u64::from(standing.state == State::Failed);
        }
        let rest = ending.and_then(|ending| ending.rest.as_ref());
        let whats = rest.into_iter().flat_map(|(events, _)| events).chain(&event);
        live.last_seq = self.tell(live.number, live.last_seq, whats)?;
        let mut end = vec![Value::Null; 4];
        match &event {
            Some(JobEvent::Queued) => live.worker_id = None,
            Some(JobEvent::Started(_, worker)) => {
                (live.worker, live.worker_id) = (Some(worker.clone()), Some(self.me));
            }
            Some(JobEvent::End(_, problem)) => {
                live.ends += 1;
                let summary = ending.and_then(|ending| ending.end.parts().2).map(json).transpose()?;
                let progress = rest.map(|(_, progress)| json(progress)).transpose()?;
                let text = problem.as_ref().map(json).transpose()?;
                end = values![text, summary, now, progress];
                self.ended(&live, problem.as_ref(), ending.map_or(&[], |ending| &ending.result))?;
            }
            _ => {}
        }
        let Standing { state, attempt, uncounted, has_begun, suspicion, .. } = standing;
        let Standing { not_before, started_at, lease_until, cancel_requested, .. } = standing;
        let mut values = values![live.number, state, attempt, uncounted, has_begun, suspicion, not_before, started_at];
        values.extend(values![lease_until, cancel_requested, live.worker.clone(), live.worker_id]);
        values.extend(values![live.last_seq, live.ends]);
        values.extend(end);
        self.rows.write(SAVE, values)?;
        self.effects.arrivals |= matches!(event, Some(JobEvent::Queued | JobEvent::End(..)));
        if event.is_some() || standing.cancel_requested != before.cancel_requested {
            self.pulse(&live);
        }
        Ok(live)
    }

    /// Writes the blobs of an ended job and its notice.
    fn ended(&mut self, live: &LiveJob, problem: Option<&Error>, result: &[SmallBlob]) -> Result<(), Abort> {
        if let Some((webhook, trace_parent)) = &live.webhook {
            let (state, problem, now) = (live.standing.state, problem.map(json).transpose()?, self.now()?);
            let notice = values![live.id, &**webhook, trace_parent.clone(), state, problem, now, live.ends];
            self.rows.write("DELETE FROM notices WHERE job = $1", values![live.id])?;
            let sql = "INSERT INTO notices (job, webhook, trace_parent, state, problem, ended_at, nth) \
                VALUES ($1, $2, $3, $4, $5, $6, $7)";
            self.rows.write(sql, notice)?;
            self.effects.endings = true;
        }
        // a job that was given up may be run again
        if !keeps_upload(problem) {
            self.rows.write("DELETE FROM blobs WHERE job = $1", values![live.number])?;
        }
        self.keep(live.number, result)
    }

    pub fn keep(&mut self, job: i64, blobs: &[SmallBlob]) -> Result<(), Abort> {
        for SmallBlob { name, bytes } in blobs {
            let sql = "INSERT INTO blobs (job, name, bytes) VALUES ($1, $2, $3)";
            self.rows.write(sql, values![job, &**name, bytes.clone()])?;
        }
        Ok(())
    }

    /// Appends events to those of a job; the number of the last one, which the caller writes to its row.
    pub fn tell<'w>(&mut self, job: i64, mut seq: u64, new: impl Iterator<Item = &'w JobEvent>) -> Result<u64, Abort> {
        for what in new {
            seq += 1;
            let (kind, data) = what.columns()?;
            let sql = "INSERT INTO events (job, seq, kind, data) VALUES ($1, $2, $3, $4)";
            self.rows.write(sql, values![job, seq, kind, data])?;
        }
        Ok(seq)
    }

    /// Wakes the tasks that wait for the job, after the commit.
    pub fn pulse(&mut self, live: &LiveJob) {
        let Standing { state, cancel_requested, .. } = live.standing;
        let pulse = Pulse { last_seq: live.last_seq, cancel_requested, ended: state.is_ended() };
        self.effects.pulses.push((live.id, Some(pulse)));
    }
}
