//! Jobs from their creation through their attempts to their end.

use std::time::Duration;

use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use super::change::{LiveJob, Transaction, job, jobs};
use super::database::{Abort, Rows, json, values};
use super::job::{Job, JobId, Progress, Ticket, no_such_job, not_failed};
use super::listeners::marked;
use super::store::Store;
use super::terms::{Created, Deletion, Ending, Event, Idempotency, NewJob, Pulse};
use crate::queue::{Change, JobEvent, Rules, State, not_yours};

/// The place of a job that is to wait, of which the tenant may have `most`. [`Kind::QueueFull`] when there is none.
fn place(rows: &mut dyn Rows, rules: &Rules, tenant: &str, most: Option<u64>, urgency: i16) -> Result<u64, Abort> {
    // no more are counted than may wait
    let sql = "SELECT count(*) AS jobs FROM (SELECT 1 FROM jobs WHERE state = 'queued' LIMIT $1) AS waiting";
    let all = rows.one(sql, values![rules.max_queued])?;
    let sql = "SELECT count(*) AS jobs, 1 + coalesce(sum(CASE WHEN urgency <= $2 THEN 1 ELSE 0 END), 0) AS place \
        FROM jobs WHERE state = 'queued' AND tenant = $1";
    let own = rows.one(sql, values![tenant, urgency])?;
    rules.check_room(all.get("jobs")?, own.get("jobs")?, most)?;
    Ok(own.get("place")?)
}

fn find(rows: &mut dyn Rows, id: JobId) -> Result<Option<Job>, Abort> {
    Ok(rows.first(jobs!("WHERE id = $1"), values![id])?.as_ref().map(job).transpose()?)
}

fn known(rows: &mut dyn Rows, tenant: &str, wanted: Option<&Idempotency>) -> Result<Option<Job>, Abort> {
    let Some(Idempotency { key, request }) = wanted else { return Ok(None) };
    let sql = jobs!("WHERE tenant = $1 AND idempotency_key = $2");
    let Some(row) = rows.first(sql, values![tenant, &**key])? else { return Ok(None) };
    if row.get::<String>("request_digest")? == *request {
        return Ok(Some(job(&row)?));
    }
    let why = "another request came with this Idempotency-Key before; send a new key with a new request";
    Err(Error::new(Kind::KeyReused, format_args!("{why}: {key:?}")).into())
}

impl Store {
    /// [`Kind::QueueFull`] when [`create`](Self::create) would be refused now, so that an upload need not come first.
    pub async fn check_room(&self, tenant: &str, most: Option<u64>) -> Result<()> {
        let (rules, tenant) = (self.rules, tenant.to_owned());
        self.read("check_room", move |rows| place(rows, &rules, &tenant, most, 0).map(drop)).await
    }

    /// Whether a job of the tenant was added with this key: then [`create`](Self::create) adds none.
    pub async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        let sql = "SELECT number FROM jobs WHERE tenant = $1 AND idempotency_key = $2";
        Ok(!self.query("knows_key", sql, values![tenant, key]).await?.is_empty())
    }

    /// Adds a job at the end of the queue. [`Kind::QueueFull`] when as many wait as may, of all tenants or of its own,
    /// which services that share a database count at once; [`Kind::KeyReused`] when its key stands for another request.
    /// When this returns, the job is as durable as anything in this store; a file that is damaged or gone takes none.
    pub async fn create(&self, new: NewJob) -> Result<Created> {
        let unfit =
            |_| Error::unavailable("the storage of the service is damaged or gone; its operator must repair it");
        self.file().map_or(Ok(()), |file| file.place.check()).map_err(unfit)?;
        self.change("create", move |change| create(change, &new)).await
    }

    pub async fn get(&self, id: JobId) -> Result<Option<Job>> {
        self.read("get", move |rows| find(rows, id)).await
    }

    /// A change by the holder of a ticket. The ticket is forgotten when it is over, by success if that `ends` it.
    async fn work<T: Send + 'static>(
        &self,
        operation: &'static str,
        ticket: Ticket,
        ends: bool,
        work: impl Fn(&mut Transaction<'_>, LiveJob) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let worked = self.change(operation, move |change| {
            let live = change.find(ticket.job)?.ok_or_else(|| no_such_job(ticket.job))?;
            work(change, live)
        });
        let outcome = worked.await;
        let is_over = match &outcome {
            Ok(_) => ends,
            Err(error) => matches!(error.kind, Kind::Conflict | Kind::NotFound),
        };
        if is_over {
            self.held.lock().remove(&ticket);
        }
        outcome
    }

    /// The worker [begins](Change::Begin) to read the mesh. Small uploads begin with their claim.
    pub async fn begin(&self, ticket: Ticket) -> Result<()> {
        let begin = Change::Begin(ticket.attempt);
        self.work("begin", ticket, false, move |change, live| change.apply(live, begin.clone(), None)).await.map(drop)
    }

    /// Gives a running job back: it waits, has failed ([`Kind::Poison`]) after too many attempts, or is cancelled.
    pub async fn release(&self, ticket: Ticket, fault: Option<Error>) -> Result<State> {
        let release = Change::Release { attempt: ticket.attempt, fault };
        let job = self.work("release", ticket, true, move |change, live| change.apply(live, release.clone(), None));
        Ok(job.await?.standing.state)
    }

    /// Ends a running job. Small blobs of its upload go, unless it is given up. Its worker may repeat it.
    pub async fn end(&self, ticket: Ticket, ending: impl Into<Ending>) -> Result<()> {
        let (ending, is_held) = (ending.into(), self.held.lock().contains_key(&ticket));
        let end = move |change: &mut Transaction<'_>, live: LiveJob| {
            let (state, problem, _) = ending.end.parts();
            let is_mine = is_held && live.worker_id == Some(change.me) && live.ticket() == ticket;
            if is_mine && live.standing.state == state {
                return Ok(());
            }
            let end = Change::End { attempt: ticket.attempt, state, problem: problem.cloned() };
            change.apply(live, end, Some(&ending)).map(drop)
        };
        self.work("finish", ticket, true, end).await
    }

    /// Appends events and replaces the progress. Repeated after a lost answer, it does nothing.
    pub async fn append(&self, ticket: Ticket, events: Vec<JobEvent>, progress: Progress) -> Result<()> {
        let before = self.held.lock().get(&ticket).copied();
        let append = move |change: &mut Transaction<'_>, mut live: LiveJob| {
            if live.ticket() != ticket || live.standing.state != State::Running {
                return Err(not_yours(ticket.job).into());
            }
            if before.is_some_and(|before| live.last_seq == before + events.len() as u64) {
                return Ok(live.last_seq);
            }
            live.last_seq = change.tell(live.number, live.last_seq, events.iter())?;
            let sql = "UPDATE jobs SET progress = $2, last_seq = $3 WHERE number = $1";
            change.rows.write(sql, values![live.number, json(&progress)?, live.last_seq])?;
            change.pulse(&live);
            Ok(live.last_seq)
        };
        let last_seq = self.work("append", ticket, false, append).await?;
        if let Some(held) = self.held.lock().get_mut(&ticket) {
            *held = last_seq;
        }
        Ok(())
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

    /// Requests the end of a job: at once while it waits; by a pulse while it runs; an ended job stays as it is. The
    /// job after that; none when there is no such job.
    pub async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        let cancelled = self.change("cancel", move |change| {
            let Some(live) = change.find(id)? else { return Ok(None) };
            change.apply(live, Change::Cancel, None)?;
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
        let sql = "SELECT bytes FROM blobs WHERE job = (SELECT number FROM jobs WHERE id = $1) AND name = $2";
        self.query("blob", sql, values![id, name]).await?.pop().map(|row| row.get("bytes")).transpose()
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
        let Some(row) = self.query("watch", sql, values![id]).await?.pop() else { return Ok(None) };
        self.listeners.pulses.publish(id, Some(Pulse::of(&row)?));
        Ok(Some(receiver))
    }

    /// Changes whenever a job may be claimed that could not be before, for idle workers. Marked as changed at first.
    pub fn arrivals(&self) -> watch::Receiver<()> {
        marked(&self.listeners.arrivals)
    }

    /// Deletes an ended job, its events and its key; its notice stays.
    pub async fn delete(&self, id: JobId) -> Result<Deletion> {
        self.change("delete", move |change| delete(change, id)).await
    }
}

fn create(change: &mut Transaction<'_>, new: &NewJob) -> Result<Created, Abort> {
    let NewJob { id, spec, idempotency, upload, most_waiting } = new;
    let idempotency = idempotency.as_ref();
    if let Some(job) = known(change.rows, &spec.tenant, idempotency)? {
        return Ok(Created::Known(job));
    }
    let urgency = -i16::from(spec.priority);
    let place = place(change.rows, &change.rules, &spec.tenant, *most_waiting, urgency)?;
    let mut values = values![*id, &*spec.tenant, json(spec)?, spec.webhook.clone(), spec.is_small];
    let (key, request) = (idempotency.map(|wanted| &*wanted.key), idempotency.map(|wanted| &*wanted.request));
    values.extend(values![json(&Progress::default())?, key, request, change.now()?, urgency]);
    let sql = "INSERT INTO jobs (id, tenant, state, spec, webhook, is_small, progress, idempotency_key, \
        request_digest, created_at, urgency, last_seq) VALUES ($1, $2, 'queued', $3, $4, $5, $6, $7, $8, $9, $10, 1) \
        ON CONFLICT DO NOTHING RETURNING *, NULL AS queue_position";
    let Some(row) = change.rows.first(sql, values)? else {
        // this job was created before, and the answer was lost; or another service took the key in this moment
        if let Some(job) = find(change.rows, *id)? {
            return Ok(Created::New(job));
        }
        let known = known(change.rows, &spec.tenant, idempotency)?.map(Created::Known);
        return known.ok_or_else(|| Error::unavailable("the job was deleted in this moment; try again").into());
    };
    let job = Job { queue_position: Some(place), ..job(&row)? };
    let number = row.get("number")?;
    change.tell(number, 0, [JobEvent::Queued].iter())?;
    change.keep(number, upload)?;
    // no task can wait for a job that was not there
    change.effects.arrivals = true;
    Ok(Created::New(job))
}

fn heartbeat(change: &mut Transaction<'_>, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>, Abort> {
    let mut lost = Vec::new();
    for ticket in tickets {
        let beat = Change::Heartbeat(ticket.attempt, lease);
        let live = change.find(ticket.job)?;
        match live.map(|live| change.apply(live, beat, None)) {
            Some(Ok(_)) => {}
            None | Some(Err(Abort::Refused(_))) => lost.push(*ticket),
            Some(Err(abort)) => return Err(abort),
        }
    }
    let now = change.now()?;
    let sql = "UPDATE workers SET seen_at = $2, \
        alive_until = CASE WHEN alive_until < $3 THEN $3 ELSE alive_until END WHERE id = $1";
    change.rows.write(sql, values![change.me, now, now + lease])?;
    Ok(lost)
}

fn retry(change: &mut Transaction<'_>, id: JobId, most: Option<u64>) -> Result<Job, Abort> {
    let live = change.find(id)?.ok_or_else(|| no_such_job(id))?;
    if live.standing.state != State::Failed {
        return Err(not_failed(live.standing.state).into());
    }
    place(change.rows, &change.rules, &live.tenant, most, 0)?;
    change.apply(live, Change::Retry, None)?;
    find(change.rows, id)?.ok_or_else(|| no_such_job(id).into())
}

fn delete(change: &mut Transaction<'_>, id: JobId) -> Result<Deletion, Abort> {
    let Some(LiveJob { number, standing, .. }) = change.find(id)? else { return Ok(Deletion::Unknown) };
    if !standing.state.is_ended() {
        return Ok(Deletion::Live);
    }
    for sql in
        ["DELETE FROM events WHERE job = $1", "DELETE FROM blobs WHERE job = $1", "DELETE FROM jobs WHERE number = $1"]
    {
        change.rows.write(sql, values![number])?;
    }
    change.effects.pulses.push((id, None));
    Ok(Deletion::Deleted)
}
