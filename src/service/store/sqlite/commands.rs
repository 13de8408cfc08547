//! What changes jobs, as SQL: each command checks, then writes, and says whom to wake.

use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection, query};

use super::super::{
    Created, Deletion, End, Ending, Job, JobId, NewJob, Progress, Pulse, Release, Rules, SmallBlob, State, Summary,
    Ticket, What, given_up, lease_is_over, no_such_job, not_yours, queue_is_full, reused_key,
};
use super::rows::{self, column, count, jobs, json, micros};
use super::writer::{Abort, Batch, Command};
use crate::error::Error;

/// Adds a job.
pub(super) struct Create(pub NewJob, pub Rules);

#[async_trait]
impl Command for Create {
    type Output = Created;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Created, Abort> {
        let Self(NewJob { id, spec, idempotency, upload }, rules) = self;
        if let Some(wanted) = idempotency {
            let known = query(jobs!("WHERE tenant = ?1 AND idempotency_key = ?2"))
                .bind(&spec.tenant)
                .bind(&wanted.key)
                .fetch_optional(&mut *batch.connection)
                .await?;
            if let Some(row) = known {
                let digest: &str = column(&row, "request_digest")?;
                if digest != wanted.request {
                    return Err(reused_key(&wanted.key).into());
                }
                return Ok(Created::Known(rows::job(&row)?));
            }
        }
        let waiting = waiting(batch.connection).await?;
        if waiting >= rules.max_queued as u64 {
            return Err(queue_is_full(rules.max_queued).into());
        }
        let created_at = rows::now();
        let progress = Progress::default();
        let inserted = query(
            "INSERT INTO jobs (id, tenant, state, spec, progress, idempotency_key, request_digest, created_at, last_seq) \
             VALUES (?1, ?2, 'queued', ?3, ?4, ?5, ?6, ?7, 1)",
        )
        .bind(id.to_string())
        .bind(&spec.tenant)
        .bind(json(spec)?)
        .bind(json(&progress)?)
        .bind(idempotency.as_ref().map(|wanted| &wanted.key))
        .bind(idempotency.as_ref().map(|wanted| &wanted.request))
        .bind(micros(created_at))
        .execute(&mut *batch.connection)
        .await?;
        let mut row = Live { id: *id, number: inserted.last_insert_rowid(), last_seq: 0, cancel_requested: false };
        keep(batch, row.number, upload).await?;
        row.tell(batch, &[What::State(State::Queued)]).await?;
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
pub(super) async fn waiting(connection: &mut SqliteConnection) -> Result<u64, Abort> {
    let row = query("SELECT count(*) AS waiting FROM jobs WHERE state = 'queued'").fetch_one(connection).await?;
    Ok(count(&row, "waiting")?)
}

/// Takes jobs from the queue.
pub(super) struct Claim {
    pub limit: usize,
    pub lease: Duration,
}

#[async_trait]
impl Command for Claim {
    type Output = Vec<(Ticket, Job)>;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let now = rows::now();
        let found = query(
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, started_at = ?1, lease_until = ?2, \
             last_seq = last_seq + 1 WHERE number IN (SELECT number FROM jobs WHERE state = 'queued' ORDER BY number LIMIT ?3) \
             RETURNING *, NULL AS queue_position",
        )
        .bind(micros(now))
        .bind(micros(now + self.lease))
        .bind(i64::try_from(self.limit).unwrap_or(i64::MAX))
        .fetch_all(&mut *batch.connection)
        .await?;
        let mut claimed = Vec::new();
        for row in found {
            let job = rows::job(&row)?;
            let mut live = Live::from_row(job.id, &row)?;
            // counted above
            live.last_seq -= 1;
            live.tell(batch, &[What::State(State::Running)]).await?;
            claimed.push((live.number, Ticket { job: job.id, attempt: job.attempt }, job));
        }
        claimed.sort_by_key(|(number, ..)| *number);
        Ok(claimed.into_iter().map(|(_, ticket, job)| (ticket, job)).collect())
    }
}

/// Prolongs leases; tells which are over.
pub(super) struct Heartbeat {
    pub tickets: Vec<Ticket>,
    pub until: SystemTime,
}

#[async_trait]
impl Command for Heartbeat {
    type Output = Vec<Ticket>;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let mut lost = Vec::new();
        for ticket in &self.tickets {
            let prolonged =
                query("UPDATE jobs SET lease_until = ?1 WHERE id = ?2 AND attempt = ?3 AND state = 'running'")
                    .bind(micros(self.until))
                    .bind(ticket.job.to_string())
                    .bind(ticket.attempt)
                    .execute(&mut *batch.connection)
                    .await?;
            if prolonged.rows_affected() == 0 {
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

#[async_trait]
impl Command for Append {
    type Output = ();

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        let (mut live, _) = claimed(batch.connection, self.ticket).await?;
        live.tell(batch, &self.events).await?;
        query("UPDATE jobs SET progress = ?1, last_seq = ?2 WHERE number = ?3")
            .bind(json(&self.progress)?)
            .bind(live.last_seq)
            .bind(live.number)
            .execute(&mut *batch.connection)
            .await?;
        Ok(())
    }
}

/// Ends a running job.
pub(super) struct Finish(pub Ticket, pub Ending);

#[async_trait]
impl Command for Finish {
    type Output = ();

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        let (mut live, _) = claimed(batch.connection, self.0).await?;
        live.end_with(batch, &self.1).await?;
        keep(batch, live.number, &self.1.result).await
    }
}

/// Gives a running job back.
pub(super) struct GiveBack(pub Ticket, pub Release, pub Rules);

#[async_trait]
impl Command for GiveBack {
    type Output = State;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<State, Abort> {
        let (mut live, row) = claimed(batch.connection, self.0).await?;
        live.release(batch, &row, &self.1, &self.2).await
    }
}

/// Gives back the jobs whose lease ended before a moment.
pub(super) struct Reclaim {
    pub now: SystemTime,
    pub rules: Rules,
}

#[async_trait]
impl Command for Reclaim {
    type Output = Vec<Ticket>;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let found = query("SELECT * FROM jobs WHERE state = 'running' AND lease_until < ?1 ORDER BY number")
            .bind(micros(self.now))
            .fetch_all(&mut *batch.connection)
            .await?;
        let mut reclaimed = Vec::new();
        for row in found {
            let id: JobId = column::<&str>(&row, "id")?.parse()?;
            let mut live = Live::from_row(id, &row)?;
            live.release(batch, &row, &Release::Failed(lease_is_over()), &self.rules).await?;
            reclaimed.push(Ticket { job: id, attempt: rows::attempt(&row)? });
        }
        Ok(reclaimed)
    }
}

/// Asks for the end of a job.
pub(super) struct Cancel(pub JobId);

#[async_trait]
impl Command for Cancel {
    type Output = Option<Job>;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort> {
        let Some(row) = find(batch.connection, self.0).await? else {
            return Ok(None);
        };
        let state = rows::state_of(column(&row, "state")?)?;
        if !state.is_ended() {
            let mut live = Live::from_row(self.0, &row)?;
            live.cancel_requested = true;
            query("UPDATE jobs SET cancel_requested = 1 WHERE number = ?1")
                .bind(live.number)
                .execute(&mut *batch.connection)
                .await?;
            match state {
                State::Queued => live.end(batch, End::Cancelled).await?,
                _ => live.pulse(batch, false),
            }
        }
        Ok(find(batch.connection, self.0).await?.map(|row| rows::job(&row)).transpose()?)
    }
}

/// Forgets an ended job.
pub(super) struct Delete(pub JobId);

#[async_trait]
impl Command for Delete {
    type Output = Deletion;

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Deletion, Abort> {
        let found = query("SELECT number, state FROM jobs WHERE id = ?1")
            .bind(self.0.to_string())
            .fetch_optional(&mut *batch.connection)
            .await?;
        let Some(row) = found else {
            return Ok(Deletion::Unknown);
        };
        if !rows::state_of(column(&row, "state")?)?.is_ended() {
            return Ok(Deletion::Live);
        }
        let number: i64 = column(&row, "number")?;
        for statement in [
            "DELETE FROM events WHERE job = ?1",
            "DELETE FROM blobs WHERE job = ?1",
            "DELETE FROM jobs WHERE number = ?1",
        ] {
            query(statement).bind(number).execute(&mut *batch.connection).await?;
        }
        batch.effects.deleted.push(self.0);
        Ok(Deletion::Deleted)
    }
}

/// The webhook of a job is told no more.
pub(super) struct SettleWebhook(pub JobId);

#[async_trait]
impl Command for SettleWebhook {
    type Output = ();

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        query("DELETE FROM notices WHERE job = ?1").bind(self.0.to_string()).execute(&mut *batch.connection).await?;
        Ok(())
    }
}

/// Writes something of no meaning.
pub(super) struct Probe;

#[async_trait]
impl Command for Probe {
    type Output = ();

    async fn apply(&self, batch: &mut Batch<'_>) -> Result<(), Abort> {
        query("INSERT OR REPLACE INTO probes (id, at) VALUES (1, ?1)")
            .bind(micros(rows::now()))
            .execute(&mut *batch.connection)
            .await?;
        Ok(())
    }
}

/// The row of a job that has not ended.
struct Live {
    id: JobId,
    number: i64,
    last_seq: i64,
    cancel_requested: bool,
}

impl Live {
    fn from_row(id: JobId, row: &SqliteRow) -> Result<Self, Error> {
        Ok(Self {
            id,
            number: column(row, "number")?,
            last_seq: column(row, "last_seq")?,
            cancel_requested: column(row, "cancel_requested")?,
        })
    }

    /// Appends events, and wakes those who wait. The row's `last_seq` is for the caller to write.
    async fn tell(&mut self, batch: &mut Batch<'_>, events: &[What]) -> Result<(), Abort> {
        let first = self.last_seq + 1;
        self.last_seq += events.len() as i64;
        match events {
            [] => {}
            [event] => {
                let (kind, data) = rows::split(event)?;
                query("INSERT INTO events (job, seq, kind, data) VALUES (?1, ?2, ?3, ?4)")
                    .bind(self.number)
                    .bind(first)
                    .bind(kind)
                    .bind(data)
                    .execute(&mut *batch.connection)
                    .await?;
            }
            // One statement for all: each has its way to the thread of the database and back.
            many => {
                let rows = many.iter().map(rows::split).collect::<Result<Vec<_>, _>>()?;
                query(
                    "INSERT INTO events (job, seq, kind, data) \
                     SELECT ?1, ?2 + key, json_extract(value, '$[0]'), json_extract(value, '$[1]') FROM json_each(?3)",
                )
                .bind(self.number)
                .bind(first)
                .bind(json(&rows)?)
                .execute(&mut *batch.connection)
                .await?;
            }
        }
        self.pulse(batch, false);
        Ok(())
    }

    /// Ends the job, with nothing else to say.
    async fn end(&mut self, batch: &mut Batch<'_>, end: End) -> Result<(), Abort> {
        self.end_with(batch, &end.into()).await
    }

    /// Ends the job; small blobs of its upload go.
    async fn end_with(&mut self, batch: &mut Batch<'_>, ending: &Ending) -> Result<(), Abort> {
        let (state, problem, summary): (_, Option<&Error>, Option<&Summary>) = match &ending.end {
            End::Succeeded(summary) => (State::Succeeded, None, Some(summary)),
            End::Failed(error) => (State::Failed, Some(error), None),
            End::Cancelled => (State::Cancelled, None, None),
        };
        let (mut events, progress) = ending.rest.clone().map_or((Vec::new(), None), |(rows, last)| (rows, Some(last)));
        events.push(What::End(state, problem.cloned()));
        self.tell(batch, &events).await?;
        let ended = query(
            "UPDATE jobs SET state = ?1, problem = ?2, summary = ?3, ended_at = ?4, lease_until = NULL, \
             progress = coalesce(?5, progress), last_seq = ?6 WHERE number = ?7 \
             RETURNING spec ->> 'webhook' IS NOT NULL AS has_webhook, spec ->> 'is_small' AS has_blobs",
        )
        .bind(state.name())
        .bind(problem.map(json).transpose()?)
        .bind(summary.map(json).transpose()?)
        .bind(micros(rows::now()))
        .bind(progress.as_ref().map(json).transpose()?)
        .bind(self.last_seq)
        .bind(self.number)
        .fetch_one(&mut *batch.connection)
        .await?;
        if ended.try_get::<i64, _>("has_webhook")? == 1 {
            query(
                "INSERT INTO notices (job, webhook, trace_parent, state, problem, ended_at) \
                 SELECT id, spec ->> 'webhook', spec ->> 'trace_parent', state, problem, ended_at FROM jobs \
                 WHERE number = ?1",
            )
            .bind(self.number)
            .execute(&mut *batch.connection)
            .await?;
            batch.effects.endings += 1;
        }
        if ended.try_get::<Option<i64>, _>("has_blobs")? == Some(1) {
            query("DELETE FROM blobs WHERE job = ?1").bind(self.number).execute(&mut *batch.connection).await?;
        }
        self.pulse(batch, true);
        Ok(())
    }

    /// Puts the job back where it was in the queue, or ends it where it must not run again.
    async fn release(
        &mut self,
        batch: &mut Batch<'_>,
        row: &SqliteRow,
        release: &Release,
        rules: &Rules,
    ) -> Result<State, Abort> {
        if self.cancel_requested {
            self.end(batch, End::Cancelled).await?;
            return Ok(State::Cancelled);
        }
        let uncounted = match release {
            Release::Free => 1,
            Release::Failed(error) => {
                let counted = count(row, "attempt")?.saturating_sub(count(row, "uncounted")?);
                if counted >= u64::from(rules.max_attempts) {
                    self.end(batch, End::Failed(given_up(counted, error))).await?;
                    return Ok(State::Failed);
                }
                0
            }
        };
        self.tell(batch, &[What::State(State::Queued)]).await?;
        query(
            "UPDATE jobs SET state = 'queued', lease_until = NULL, uncounted = uncounted + ?1, last_seq = ?2 \
             WHERE number = ?3",
        )
        .bind(uncounted)
        .bind(self.last_seq)
        .bind(self.number)
        .execute(&mut *batch.connection)
        .await?;
        batch.effects.arrivals += 1;
        Ok(State::Queued)
    }

    fn pulse(&self, batch: &mut Batch<'_>, ended: bool) {
        let last_seq = self.last_seq.unsigned_abs();
        batch.effects.pulses.push((self.id, Pulse { last_seq, cancel_requested: self.cancel_requested, ended }));
    }
}

/// Keeps small blobs of a job.
async fn keep(batch: &mut Batch<'_>, number: i64, blobs: &[SmallBlob]) -> Result<(), Abort> {
    for SmallBlob { name, bytes } in blobs {
        query("INSERT INTO blobs (job, name, bytes) VALUES (?1, ?2, ?3)")
            .bind(number)
            .bind(name)
            .bind(&bytes[..])
            .execute(&mut *batch.connection)
            .await?;
    }
    Ok(())
}

/// The row of a job, with its place in the queue.
async fn find(connection: &mut SqliteConnection, id: JobId) -> Result<Option<SqliteRow>, sqlx::Error> {
    query(jobs!("WHERE id = ?1")).bind(id.to_string()).fetch_optional(connection).await
}

/// The running job that a ticket is valid for.
async fn claimed(connection: &mut SqliteConnection, ticket: Ticket) -> Result<(Live, SqliteRow), Abort> {
    let row = query("SELECT number, state, attempt, uncounted, last_seq, cancel_requested FROM jobs WHERE id = ?1")
        .bind(ticket.job.to_string())
        .fetch_optional(connection)
        .await?
        .ok_or_else(|| no_such_job(ticket.job))?;
    let is_running = rows::state_of(column(&row, "state")?)? == State::Running;
    if !is_running || rows::attempt(&row)? != ticket.attempt {
        return Err(not_yours(ticket.job).into());
    }
    Ok((Live::from_row(ticket.job, &row)?, row))
}
