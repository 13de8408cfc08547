//! Jobs from their creation through their attempts to their end.

use std::time::Duration;

use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use super::change::{Live, Transaction, job, jobs};
use super::database::rows::{Abort, Row, Rows, json, values};
use super::job::{Job, JobId, Progress, SmallBlob, Ticket, no_such_job, not_failed};
use super::store::Store;
#[cfg(test)]
use super::terms::End;
use super::terms::{Created, Deletion, Ending, Event, Idempotency, NewJob, Pulse, What};
use crate::queue::{Change, Refused, Release, Rules, Standing, State, not_yours};

const KNOWN: &str = jobs!("WHERE tenant = $1 AND idempotency_key = $2");

const BY_ID: &str = jobs!("WHERE id = $1");

/// Counts the jobs that wait, to the limit at most.
const WAITING: &str = "SELECT count(*) AS jobs FROM (SELECT 1 FROM jobs WHERE state = 'queued' LIMIT $1) AS waiting";

const CREATE: &str = "INSERT INTO jobs (id, tenant, state, spec, webhook, is_small, progress, idempotency_key, \
    request_digest, created_at, urgency, last_seq) VALUES ($1, $2, 'queued', $3, $4, $5, $6, $7, $8, $9, $10, 1) \
    ON CONFLICT DO NOTHING RETURNING number";

/// The waiting jobs of a tenant, and the place of a new one among them.
const OF_TENANT: &str = "SELECT count(*) AS jobs, \
    1 + coalesce(sum(CASE WHEN urgency <= $2 THEN 1 ELSE 0 END), 0) AS place \
    FROM jobs WHERE state = 'queued' AND tenant = $1";

/// The place of a job that is to wait, of which the tenant may have `most`. [`Kind::QueueFull`] when there is none.
fn place(rows: &mut dyn Rows, rules: &Rules, tenant: &str, most: Option<u64>, urgency: i16) -> Result<u64, Abort> {
    let found = rows.all(&[(WAITING, values![rules.max_queued]), (OF_TENANT, values![tenant, urgency])])?;
    let found: Vec<Row> = found.into_iter().flatten().collect();
    let [all, own] = &found[..] else { return Err(Abort::Broken(Error::new(Kind::Internal, "a count gave no row"))) };
    rules.check_room(all.get("jobs")?, own.get("jobs")?, most)?;
    Ok(own.get("place")?)
}

fn find(rows: &mut dyn Rows, id: JobId) -> Result<Option<Job>, Abort> {
    Ok(rows.first(BY_ID, values![id])?.as_ref().map(job).transpose()?)
}

fn known(rows: &mut dyn Rows, tenant: &str, wanted: &Idempotency) -> Result<Option<Job>, Abort> {
    let Some(row) = rows.first(KNOWN, values![tenant, &*wanted.key])? else { return Ok(None) };
    if row.text("request_digest")? == wanted.request {
        return Ok(Some(job(&row)?));
    }
    let why = "another request came with this Idempotency-Key before; send a new key with a new request";
    Err(Error::new(Kind::KeyReused, format_args!("{why}: {:?}", wanted.key)).into())
}

impl Store {
    /// [`Kind::QueueFull`] when [`create`](Self::create) would be refused now, so that an upload need not come first.
    pub async fn check_room(&self, tenant: &str, most: Option<u64>) -> Result<()> {
        let (rules, tenant) = (self.rules, tenant.to_owned());
        self.read("check_room", move |rows| place(rows, &rules, &tenant, most, 0).map(drop)).await
    }

    /// Whether a job of the tenant was added with this key: then [`create`](Self::create) adds none.
    pub async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        let values = values![tenant, key];
        let sql = "SELECT number FROM jobs WHERE tenant = $1 AND idempotency_key = $2";
        Ok(self.read("knows_key", move |rows| rows.first(sql, values.clone())).await?.is_some())
    }

    /// Adds a job at the end of the queue. [`Kind::QueueFull`] when as many wait as may, of all tenants or of its own,
    /// which services that share a database count at once; [`Kind::KeyReused`] when its
    /// key stands for another request. When this returns, the job is as durable as anything in this store.
    pub async fn create(&self, new: NewJob) -> Result<Created> {
        self.change("create", move |change| create(change, &new)).await
    }

    pub async fn get(&self, id: JobId) -> Result<Option<Job>> {
        self.read("get", move |rows| find(rows, id)).await
    }

    /// The worker begins to read the mesh: from now on the attempt counts. Small uploads begin with their claim.
    /// Nothing happens when the attempt has begun already.
    pub async fn begin(&self, ticket: Ticket) -> Result<()> {
        let begun = self.change("begin", move |change| {
            let live = change.of_ticket(ticket)?;
            change.worked(live, Change::Begin { attempt: ticket.attempt }, None).map(drop)
        });
        self.fenced(ticket, begun.await, false)
    }

    /// Makes leases end this long after now, by the clock of the store; returns the tickets that are over.
    pub async fn heartbeat(&self, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>> {
        let mut tickets = tickets.to_vec();
        // in one order, so that no two changes wait for each other
        tickets.sort_by_key(|ticket| ticket.job);
        let lost = self.change("heartbeat", move |change| heartbeat(change, &tickets, lease)).await?;
        self.held.lock().retain(|ticket, _| !lost.contains(ticket));
        Ok(lost)
    }

    /// Gives a running job back: it waits again, or has failed ([`Kind::Poison`]) after too many attempts, or is
    /// cancelled where that was requested.
    pub async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        let released = self.change("release", move |change| {
            let live = change.of_ticket(ticket)?;
            let release = Change::Release { attempt: ticket.attempt, release: release.clone() };
            Ok(change.worked(live, release, None)?.standing.state)
        });
        self.fenced(ticket, released.await, true)
    }

    /// Ends a running job. Small blobs of its upload go, unless it is given up. Nothing happens where this worker ended
    /// it so before: the answer to that was lost.
    pub async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        let is_held = self.held.lock().contains_key(&ticket);
        let ended = self.change("finish", move |change| end(change, ticket, &ending, is_held)).await;
        self.fenced(ticket, ended, true)
    }

    #[cfg(test)]
    pub async fn finish(&self, ticket: Ticket, end: End) -> Result<()> {
        self.end(ticket, end.into()).await
    }

    /// Forgets a ticket that is over, by success if that `ends` it.
    fn fenced<T>(&self, ticket: Ticket, outcome: Result<T>, ends: bool) -> Result<T> {
        let is_over = match &outcome {
            Ok(_) => ends,
            Err(error) => matches!(error.kind, Kind::Conflict | Kind::NotFound),
        };
        if is_over {
            self.held.lock().remove(&ticket);
        }
        outcome
    }

    /// Requests the end of a job: at once while it waits; by a pulse while it runs; an ended job stays as it is. The
    /// job after that; none when there is no such job.
    pub async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        let cancelled = self.change("cancel", move |change| {
            let Some(live) = change.find(id)? else { return Ok(None) };
            change.worked(live, Change::Cancel, None)?;
            find(change.rows, id)
        });
        cancelled.await
    }

    /// Puts a failed job back into the queue, with no attempt counted. Its upload must still be there.
    /// [`Kind::QueueFull`] when as many jobs wait as may, or `most` of its tenant; [`Kind::Conflict`] in another state.
    pub async fn retry(&self, id: JobId, most: Option<u64>) -> Result<Job> {
        self.change("retry", move |change| retry(change, id, most)).await
    }

    /// A small blob of a job: of its upload until it ends, of its result from then on.
    pub async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        let values = values![id, name];
        let sql = "SELECT bytes FROM blobs WHERE job = (SELECT number FROM jobs WHERE id = $1) AND name = $2";
        let row = self.read("blob", move |rows| rows.first(sql, values.clone())).await?;
        row.map(|row| row.get("bytes")).transpose()
    }

    /// Appends events and replaces the progress. Nothing happens where they were appended before: the answer to that
    /// was lost.
    pub async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        let before = self.held.lock().get(&ticket).copied();
        let appended = self.change("append", move |change| append(change, ticket, &events, &progress, before)).await;
        if let (Ok(last_seq), Some(held)) = (&appended, self.held.lock().get_mut(&ticket)) {
            *held = *last_seq;
        }
        self.fenced(ticket, appended, false).map(drop)
    }

    /// At most `limit` events of a job from number `after + 1` on; none when there is no such job.
    pub async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        let found = self.read("events", move |rows| {
            let Some(row) = rows.first("SELECT number FROM jobs WHERE id = $1", values![id])? else { return Ok(None) };
            let sql = "SELECT seq, kind, data FROM events WHERE job = $1 AND seq > $2 ORDER BY seq LIMIT $3";
            let rows = rows.query(sql, values![row.get::<i64>("number")?, after, limit])?;
            Ok(Some(rows.iter().map(Event::of).collect::<Result<_>>()?))
        });
        found.await
    }

    /// A receiver of every change of a job until it is deleted; none when there is no such job.
    pub async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        let receiver = self.listeners.pulses.subscribe(id);
        let sql = "SELECT last_seq, cancel_requested, state FROM jobs WHERE id = $1";
        let Some(row) = self.read("watch", move |rows| rows.first(sql, values![id])).await? else { return Ok(None) };
        self.listeners.pulses.publish(id, Pulse::of(&row)?);
        Ok(Some(receiver))
    }

    /// Changes whenever a job may be claimed that could not be before: idle workers wait for it. Marked as changed from
    /// the start.
    pub fn arrivals(&self) -> watch::Receiver<u64> {
        self.listeners.arrivals.subscribe()
    }

    /// Deletes an ended job, its events and its key; its notice stays.
    pub async fn delete(&self, id: JobId) -> Result<Deletion> {
        self.change("delete", move |change| delete(change, id)).await
    }
}

fn create(change: &mut Transaction<'_>, new: &NewJob) -> Result<Created, Abort> {
    let NewJob { id, spec, idempotency, upload, most_waiting } = new;
    if let Some(wanted) = idempotency
        && let Some(job) = known(change.rows, &spec.tenant, wanted)?
    {
        return Ok(Created::Known(job));
    }
    let urgency = -i16::from(spec.priority);
    let place = place(change.rows, &change.rules, &spec.tenant, *most_waiting, urgency)?;
    let created_at = change.now()?;
    let mut job = Job::queued(*id, spec.clone(), created_at);
    job.queue_position = Some(place);
    let key = idempotency.as_ref().map(|wanted| &*wanted.key);
    let request = idempotency.as_ref().map(|wanted| &*wanted.request);
    let (text, progress) = (json(spec)?, json(&job.progress)?);
    let (webhook, is_small) = (spec.webhook.clone(), spec.is_small);
    let values = values![*id, &*spec.tenant, text, webhook, is_small, progress, key, request, created_at, urgency];
    let Some(row) = change.rows.first(CREATE, values)? else {
        // another service took the key in this moment; or this job was created before, and the answer was lost
        return match (find(change.rows, *id)?, idempotency) {
            (Some(job), _) => Ok(Created::New(job)),
            (None, Some(wanted)) => match known(change.rows, &spec.tenant, wanted)? {
                Some(job) => Ok(Created::Known(job)),
                None => Err(Error::new(Kind::Unavailable, "the job was deleted in this moment; try again").into()),
            },
            (None, None) => Err(Error::new(Kind::Internal, "a new job was not stored").into()),
        };
    };
    let number = row.get("number")?;
    let (_, event) = Standing::created(spec.is_small);
    change.tell(number, 1, &event.into())?;
    for SmallBlob { name, bytes } in upload {
        change.keep(number, name, bytes)?;
    }
    // no task can wait for a job that was not there
    change.effects.arrivals = true;
    Ok(Created::New(job))
}

fn heartbeat(change: &mut Transaction<'_>, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>, Abort> {
    let mut lost = Vec::new();
    for ticket in tickets {
        let beat = Change::Heartbeat { attempt: ticket.attempt, lease };
        let is_held = match change.find(ticket.job)? {
            Some(live) => change.apply(live, beat, None)?.is_ok(),
            None => false,
        };
        if !is_held {
            lost.push(*ticket);
        }
    }
    let now = change.now()?;
    let sql = "UPDATE workers SET seen_at = $2, alive_until = $3 WHERE id = $1 AND alive_until < $3";
    change.rows.write(sql, values![change.me, now, now + lease])?;
    Ok(lost)
}

fn end(change: &mut Transaction<'_>, ticket: Ticket, ending: &Ending, is_held: bool) -> Result<(), Abort> {
    let (state, problem, _) = ending.end.parts();
    let live = change.of_ticket(ticket)?;
    let is_repeated = is_held && live.worker_id == Some(change.me) && live.ticket() == ticket;
    let problem = problem.cloned();
    match change.apply(live, Change::End { attempt: ticket.attempt, state, problem }, Some(ending))? {
        Err(Refused(ended)) if ended != state || !is_repeated => Err(not_yours(ticket.job).into()),
        _ => Ok(()),
    }
}

fn append(
    change: &mut Transaction<'_>,
    ticket: Ticket,
    events: &[What],
    progress: &Progress,
    before: Option<u64>,
) -> Result<u64, Abort> {
    let mut live = change.of_ticket(ticket)?;
    if live.ticket() != ticket || live.standing.state != State::Running {
        return Err(not_yours(ticket.job).into());
    }
    if before.is_some_and(|before| live.last_seq == before + events.len() as u64) {
        return Ok(live.last_seq);
    }
    change.tell_all(&mut live, events)?;
    let sql = "UPDATE jobs SET progress = $2, last_seq = $3 WHERE number = $1";
    change.rows.write(sql, values![live.number, json(progress)?, live.last_seq])?;
    change.pulse(&live);
    Ok(live.last_seq)
}

fn retry(change: &mut Transaction<'_>, id: JobId, most: Option<u64>) -> Result<Job, Abort> {
    let live = change.find(id)?.ok_or_else(|| no_such_job(id))?;
    if live.standing.state == State::Failed {
        place(change.rows, &change.rules, &live.tenant, most, 0)?;
    }
    if let Err(Refused(state)) = change.apply(live, Change::Retry, None)? {
        return Err(not_failed(state).into());
    }
    find(change.rows, id)?.ok_or_else(|| no_such_job(id).into())
}

fn delete(change: &mut Transaction<'_>, id: JobId) -> Result<Deletion, Abort> {
    let Some(Live { number, standing, .. }) = change.find(id)? else { return Ok(Deletion::Unknown) };
    if !standing.state.is_ended() {
        return Ok(Deletion::Live);
    }
    for sql in
        ["DELETE FROM events WHERE job = $1", "DELETE FROM blobs WHERE job = $1", "DELETE FROM jobs WHERE number = $1"]
    {
        change.rows.write(sql, values![number])?;
    }
    change.effects.deleted.push(id);
    Ok(Deletion::Deleted)
}
