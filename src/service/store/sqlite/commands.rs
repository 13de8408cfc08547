//! What changes jobs, as SQL. A command refuses before it writes; the writer may call it again when the transaction
//! failed. Claims and the recovery after a crash are in [`claim`](super::claim).

use std::time::{Duration, SystemTime};

use rusqlite::{Connection, params};

use super::super::{
    ALONE_FROM, Created, Deletion, End, Ending, Job, JobId, NewJob, Progress, Release, Retried, Rules, State, Ticket,
    What, reused_key,
};
use super::connections::{Abort, all, execute, first, one};
use super::live::Live;
use super::rows::{self, count, jobs, json, micros, text};
use super::writer::Batch;
use crate::error::Result;

/// Pages that are given back to the file system at once.
const GIVEN_BACK: u32 = 1024;

/// The job as it is now.
pub(super) fn find(connection: &Connection, id: JobId) -> Result<Option<Job>, Abort> {
    first(connection, jobs!("WHERE id = ?1"), [id.to_string()], rows::job)
}

/// [`Kind::QueueFull`](crate::Kind) when as many jobs wait as may.
pub(super) fn check_room(connection: &Connection, rules: &Rules) -> Result<(), Abort> {
    let sql = "SELECT coalesce(sum(queued), 0) AS jobs FROM tenants";
    Ok(rules.check_room(one(connection, sql, [], |row| count(row, "jobs"))?)?)
}

/// Adds a job.
pub(super) fn create(batch: &mut Batch<'_>, new: &NewJob, rules: &Rules) -> Result<Created, Abort> {
    let NewJob { id, spec, idempotency, upload } = new;
    if let Some(wanted) = idempotency {
        let sql = jobs!("WHERE tenant = ?1 AND idempotency_key = ?2");
        let known = first(batch.connection, sql, params![spec.tenant, wanted.key], |row| {
            match text(row, "request_digest")? == wanted.request {
                true => rows::job(row),
                false => Err(reused_key(&wanted.key)),
            }
        });
        if let Some(job) = known? {
            return Ok(Created::Known(job));
        }
    }
    check_room(batch.connection, rules)?;
    let mut job = Job::queued(*id, spec.clone(), rows::now());
    let (spec_json, progress) = (json(spec)?, json(&job.progress)?);
    let urgency = -i64::from(spec.priority);
    execute(
        batch.connection,
        "INSERT INTO jobs (id, tenant, state, spec, progress, idempotency_key, request_digest, created_at, urgency, \
         last_seq) VALUES (?1, ?2, 'queued', ?3, ?4, ?5, ?6, ?7, ?8, 1)",
        params![
            id.to_string(),
            spec.tenant,
            spec_json,
            progress,
            idempotency.as_ref().map(|wanted| &wanted.key),
            idempotency.as_ref().map(|wanted| &wanted.request),
            micros(job.created_at),
            urgency
        ],
    )?;
    let number = batch.connection.last_insert_rowid();
    let sql = "SELECT count(*) AS jobs FROM jobs WHERE state = 'queued' AND tenant = ?1 \
               AND (urgency, number) <= (?2, ?3)";
    let place = one(batch.connection, sql, params![spec.tenant, urgency, number], |row| count(row, "jobs"))?;
    job.queue_position = Some(place);
    let mut live = Live::new(*id, number);
    live.keep(batch, upload)?;
    batch.effects.uploads.push((*id, upload.clone()));
    live.append(batch, &[What::State(State::Queued)])?;
    batch.effects.arrivals = true;
    Ok(Created::New(job))
}

/// Prolongs leases until `lease` from now; the tickets that are over.
pub(super) fn heartbeat(batch: &mut Batch<'_>, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>, Abort> {
    let until = micros(rows::now() + lease);
    let mut lost = Vec::new();
    for ticket in tickets {
        let sql = "UPDATE jobs SET lease_until = ?1 WHERE id = ?2 AND attempt = ?3 AND state = 'running'";
        if execute(batch.connection, sql, params![until, ticket.job.to_string(), ticket.attempt])? == 0 {
            lost.push(*ticket);
        }
    }
    Ok(lost)
}

/// The attempt counts from now on.
pub(super) fn begin(batch: &mut Batch<'_>, ticket: Ticket) -> Result<(), Abort> {
    let live = Live::claimed(batch.connection, ticket)?;
    if !live.has_begun {
        execute(batch.connection, "UPDATE jobs SET begun = 1 WHERE number = ?1", [live.number])?;
    }
    Ok(())
}

/// Appends events and replaces the progress.
pub(super) fn append(batch: &mut Batch<'_>, ticket: Ticket, events: &[What], progress: &Progress) -> Result<(), Abort> {
    let mut live = Live::claimed(batch.connection, ticket)?;
    live.append(batch, events)?;
    let sql = "UPDATE jobs SET progress = ?1, last_seq = ?2 WHERE number = ?3";
    execute(batch.connection, sql, params![json(progress)?, live.last_seq, live.number])?;
    Ok(())
}

/// Ends a running job.
pub(super) fn end(batch: &mut Batch<'_>, ticket: Ticket, ending: &Ending) -> Result<(), Abort> {
    let mut live = Live::claimed(batch.connection, ticket)?;
    live.end(batch, &ending.end, ending.rest.as_ref())?;
    live.keep(batch, &ending.result)
}

/// Gives a running job back.
pub(super) fn release(batch: &mut Batch<'_>, ticket: Ticket, release: &Release, rules: &Rules) -> Result<State, Abort> {
    Live::claimed(batch.connection, ticket)?.release(batch, release, rules)
}

/// Gives back the running jobs whose lease is over.
pub(super) fn reclaim(batch: &mut Batch<'_>, rules: &Rules) -> Result<Vec<Ticket>, Abort> {
    let sql = "SELECT * FROM jobs WHERE state = 'running' AND lease_until <= ?1 ORDER BY number";
    let found = all(batch.connection, sql, [micros(rows::now())], |row| Live::from_row(rows::id(row, "id")?, row))?;
    let mut reclaimed = Vec::new();
    for mut live in found {
        match live.has_begun {
            true => live.abandoned(batch, rules, rows::now())?,
            false => live.free(batch, rows::now())?,
        };
        reclaimed.push(Ticket { job: live.id, attempt: live.attempt });
    }
    Ok(reclaimed)
}

/// Requests the end of a job.
pub(super) fn cancel(batch: &mut Batch<'_>, id: JobId) -> Result<Option<Job>, Abort> {
    let Some((state, mut live)) = Live::find(batch.connection, id)? else { return Ok(None) };
    if !state.is_ended() {
        live.cancel_requested = true;
        execute(batch.connection, "UPDATE jobs SET cancel_requested = 1 WHERE number = ?1", [live.number])?;
        match state {
            State::Queued => live.end(batch, &End::Cancelled, None)?,
            _ => live.pulse(batch, false),
        }
    }
    find(batch.connection, id)
}

/// Runs a failed job again.
pub(super) fn retry(batch: &mut Batch<'_>, id: JobId, rules: &Rules) -> Result<Retried, Abort> {
    let Some((state, mut live)) = Live::find(batch.connection, id)? else { return Ok(Retried::Unknown) };
    if state != State::Failed {
        return Ok(Retried::NotFailed(state));
    }
    check_room(batch.connection, rules)?;
    let sql = "UPDATE jobs SET problem = NULL, ended_at = NULL, cancel_requested = 0 WHERE number = ?1";
    execute(batch.connection, sql, [live.number])?;
    live.cancel_requested = false;
    live.uncounted = live.attempt;
    // a job that may kill the process still starts alone, but at once
    live.suspicion = live.suspicion.min(ALONE_FROM);
    live.queue(batch, rows::now())?;
    Ok(find(batch.connection, id)?.map_or(Retried::Unknown, |job| Retried::Queued(Box::new(job))))
}

/// Removes an ended job.
pub(super) fn delete(batch: &mut Batch<'_>, id: JobId) -> Result<Deletion, Abort> {
    let Some((state, Live { number, .. })) = Live::find(batch.connection, id)? else { return Ok(Deletion::Unknown) };
    if !state.is_ended() {
        return Ok(Deletion::Live);
    }
    for sql in
        ["DELETE FROM events WHERE job = ?1", "DELETE FROM blobs WHERE job = ?1", "DELETE FROM jobs WHERE number = ?1"]
    {
        execute(batch.connection, sql, [number])?;
    }
    batch.effects.deleted.push(id);
    Ok(Deletion::Deleted)
}

/// Removes the notice of the end of a job at that moment.
pub(super) fn settle_webhook(batch: &mut Batch<'_>, id: JobId, ended_at: SystemTime) -> Result<(), Abort> {
    let sql = "DELETE FROM notices WHERE job = ?1 AND ended_at = ?2";
    execute(batch.connection, sql, params![id.to_string(), micros(ended_at)])?;
    Ok(())
}

/// Cuts free pages off the end of the file, as far as it was made for that.
pub(super) fn give_back(batch: &mut Batch<'_>) -> Result<(), Abort> {
    // a row a page
    all(batch.connection, &format!("PRAGMA incremental_vacuum({GIVEN_BACK})"), [], |_| Ok(()))?;
    batch.effects.shrinks = true;
    Ok(())
}

/// Writes a row without meaning.
pub(super) fn probe(batch: &mut Batch<'_>) -> Result<(), Abort> {
    let sql = "INSERT OR REPLACE INTO probes (id, at) VALUES (1, ?1)";
    execute(batch.connection, sql, [micros(rows::now())])?;
    Ok(())
}
