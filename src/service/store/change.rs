//! A change of jobs: its transaction, and the row of a job that changes.
//!
//! [`queue`](crate::queue) says what a change makes of a job; this writes the row and the events.

use std::time::SystemTime;

use tesserae_mesh::error::{Error, Result};
use uuid::Uuid;

use super::database::rows::{Abort, Row, Rows, json, values};
use super::job::{Job, JobId, Progress, Spec, Ticket, keeps_upload, no_such_job};
use super::listeners::Effects;
use super::terms::{Ending, Pulse, What};
use crate::queue::{Change, Event, Refused, Rules, Standing, State, not_yours};

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

/// A job, from a row that [`jobs!`] selected.
pub fn job(row: &Row) -> Result<Job> {
    Ok(Job { queue_position: row.get("queue_position")?, ..unplaced(row)? })
}

/// A job without its place in the queue.
pub fn unplaced(row: &Row) -> Result<Job> {
    Ok(Job {
        id: row.get("id")?,
        state: row.get("state")?,
        spec: row.json("spec")?,
        queue_position: None,
        attempt: row.get("attempt")?,
        worker: row.get("worker")?,
        progress: row.json("progress")?,
        cancel_requested: row.get("cancel_requested")?,
        problem: row.optional_json("problem")?,
        summary: row.optional_json("summary")?,
        created_at: row.get("created_at")?,
        started_at: row.get("started_at")?,
        ended_at: row.get("ended_at")?,
    })
}

pub fn standing(row: &Row) -> Result<Standing> {
    Ok(Standing {
        state: row.get("state")?,
        is_small: row.get("is_small")?,
        attempt: row.get("attempt")?,
        uncounted: row.get("uncounted")?,
        has_begun: row.get("begun")?,
        suspicion: row.get("suspicion")?,
        not_before: row.get("not_before")?,
        started_at: row.get("started_at")?,
        lease_until: row.get("lease_until")?,
        cancel_requested: row.get("cancel_requested")?,
    })
}

const FIND: &str = "SELECT * FROM jobs WHERE id = $1 FOR UPDATE";

/// Without what claims alone change: the attempt, its start and its worker's name.
const SAVE: &str = "UPDATE jobs SET state = $2, uncounted = $3, begun = $4, suspicion = $5, not_before = $6, \
    lease_until = $7, cancel_requested = $8, worker_id = $9, last_seq = $10, ends = $11, problem = $12, \
    summary = $13, ended_at = $14, progress = coalesce($15, progress) WHERE number = $1";

const NOTICE: &str = "INSERT INTO notices (job, webhook, trace_parent, state, problem, ended_at, nth) \
    VALUES ($1, $2, $3, $4, $5, $6, $7)";

#[derive(Debug)]
pub struct Live {
    pub id: JobId,
    pub number: i64,
    pub tenant: String,
    pub standing: Standing,
    pub last_seq: u64,
    pub worker_id: Option<Uuid>,
    /// The URL that its end is sent to, and the `traceparent` for that.
    pub webhook: Option<(String, Option<String>)>,
    pub ends: u32,
}

impl Live {
    pub fn of(row: &Row) -> Result<Self> {
        let webhook = |webhook| Ok((webhook, row.json::<Spec>("spec")?.trace_parent));
        Ok(Self {
            id: row.get("id")?,
            number: row.get("number")?,
            tenant: row.get("tenant")?,
            standing: standing(row)?,
            last_seq: row.get("last_seq")?,
            worker_id: row.get("worker_id")?,
            webhook: row.get::<Option<String>>("webhook")?.map(webhook).transpose()?,
            ends: row.get("ends")?,
        })
    }

    pub fn ticket(&self) -> Ticket {
        Ticket { job: self.id, attempt: self.standing.attempt }
    }
}

impl Transaction<'_> {
    /// Now by the clock of the store: one moment for all that the change does.
    pub fn now(&mut self) -> Result<SystemTime, Abort> {
        let now = match self.now {
            Some(now) => now,
            None => self.rows.now()?,
        };
        Ok(*self.now.insert(now))
    }

    /// The job of that id, locked.
    pub fn find(&mut self, id: JobId) -> Result<Option<Live>, Abort> {
        Ok(self.rows.first(FIND, values![id])?.as_ref().map(Live::of).transpose()?)
    }

    /// The job of a ticket, which the rules check.
    pub fn of_ticket(&mut self, ticket: Ticket) -> Result<Live, Abort> {
        self.find(ticket.job)?.ok_or_else(|| no_such_job(ticket.job).into())
    }

    /// A job of a worker after a change, or [`Kind::Conflict`](tesserae_mesh::Kind::Conflict).
    pub fn worked(&mut self, live: Live, change: Change, ending: Option<&Ending>) -> Result<Live, Abort> {
        let id = live.id;
        self.apply(live, change, ending)?.map_err(|Refused(_)| not_yours(id).into())
    }

    /// The job after a change that the rules allow.
    pub fn apply(
        &mut self,
        mut live: Live,
        change: Change,
        ending: Option<&Ending>,
    ) -> Result<Result<Live, Refused>, Abort> {
        let now = self.now()?;
        let (before, rules) = (live.standing, self.rules);
        let is_fault = match change {
            Change::LeaseOver => before.has_begun,
            Change::Crashed { counts } => counts,
            _ => false,
        };
        let (standing, event) = match before.apply(change, &rules, now) {
            Ok(after) => after,
            Err(refused) => return Ok(Err(refused)),
        };
        live.standing = standing;
        if standing.state == State::Queued {
            live.worker_id = None;
        }
        if standing == before && event.is_none() {
            return Ok(Ok(live));
        }
        if is_fault {
            self.effects.attempts_failed += 1;
            self.effects.given_up += u64::from(standing.state == State::Failed);
        }
        if let Some((events, _)) = ending.and_then(|ending| ending.rest.as_ref()) {
            self.tell_all(&mut live, events)?;
        }
        self.effects.arrivals |= event == Some(Event::Queued);
        let is_told = event.is_some();
        let end = match &event {
            Some(Event::End(_, problem)) => Some(problem.clone()),
            _ => None,
        };
        if let Some(event) = event {
            self.tell_all(&mut live, &[event.into()])?;
        }
        match end {
            Some(problem) => self.ended(&mut live, problem, ending, now)?,
            None => self.save(&live, None, None, None, None)?,
        }
        if is_told || standing.cancel_requested != before.cancel_requested {
            self.pulse(&live);
        }
        Ok(Ok(live))
    }

    /// Writes an ended job, its blobs and its notice.
    fn ended(
        &mut self,
        live: &mut Live,
        problem: Option<Error>,
        ending: Option<&Ending>,
        now: SystemTime,
    ) -> Result<(), Abort> {
        live.ends += 1;
        let progress = ending.and_then(|ending| ending.rest.as_ref()).map(|(_, progress)| progress);
        let summary = ending.and_then(|ending| ending.end.parts().2).map(json).transpose()?;
        let text = problem.as_ref().map(json).transpose()?;
        self.save(live, text.clone(), summary, Some(now), progress)?;
        if let Some((webhook, trace_parent)) = live.webhook.clone() {
            let state = live.standing.state;
            self.rows.write("DELETE FROM notices WHERE job = $1", values![live.id])?;
            self.rows.write(NOTICE, values![live.id, webhook, trace_parent, state, text, now, live.ends])?;
            self.effects.endings = true;
        }
        // a job that was given up may be run again
        if !keeps_upload(problem.as_ref()) {
            self.rows.write("DELETE FROM blobs WHERE job = $1", values![live.number])?;
        }
        for blob in ending.iter().flat_map(|ending| &ending.result) {
            self.keep(live.number, &blob.name, &blob.bytes)?;
        }
        self.effects.arrivals = true;
        Ok(())
    }

    pub fn keep(&mut self, job: i64, name: &str, bytes: &tokio_util::bytes::Bytes) -> Result<(), Abort> {
        let sql = "INSERT INTO blobs (job, name, bytes) VALUES ($1, $2, $3)";
        self.rows.write(sql, values![job, name, bytes.clone()])
    }

    /// Appends events. The caller writes `last_seq` to the row.
    pub fn tell_all(&mut self, live: &mut Live, events: &[What]) -> Result<(), Abort> {
        for event in events {
            live.last_seq += 1;
            self.tell(live.number, live.last_seq, event)?;
        }
        Ok(())
    }

    pub fn tell(&mut self, job: i64, seq: u64, event: &What) -> Result<(), Abort> {
        let [kind, data] = event.columns()?;
        let sql = "INSERT INTO events (job, seq, kind, data) VALUES ($1, $2, $3, $4)";
        self.rows.write(sql, values![job, seq, kind, data])
    }

    fn save(
        &mut self,
        live: &Live,
        problem: Option<String>,
        summary: Option<String>,
        ended_at: Option<SystemTime>,
        progress: Option<&Progress>,
    ) -> Result<(), Abort> {
        let Standing { state, uncounted, has_begun, suspicion, .. } = live.standing;
        let Standing { not_before, lease_until, cancel_requested, .. } = live.standing;
        self.rows.write(
            SAVE,
            values![
                live.number,
                state,
                uncounted,
                has_begun,
                suspicion,
                not_before,
                lease_until,
                cancel_requested,
                live.worker_id,
                live.last_seq,
                live.ends,
                problem,
                summary,
                ended_at,
                progress.map(json).transpose()?,
            ],
        )
    }

    /// Wakes the tasks that wait for the job, after the commit.
    pub fn pulse(&mut self, live: &Live) {
        let Standing { state, cancel_requested, .. } = live.standing;
        let pulse = Pulse { last_seq: live.last_seq, cancel_requested, ended: state.is_ended() };
        self.effects.pulses.push((live.id, pulse));
    }
}
