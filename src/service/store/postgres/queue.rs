//! The queue: creation, claims, ends, and what clients ask about jobs.

use std::time::{Duration, Instant, SystemTime};

use async_trait::async_trait;
use tokio::sync::watch;
use tokio_postgres::types::Json;
use tokio_util::bytes::Bytes;
use uuid::Uuid;

use super::super::{
    ALONE_FROM, Claiming, Created, End, Ending, Job, JobId, ListQuery, NewJob, Page, Progress, Pulse, Queue, Release,
    Retried, Rules, SMALL_BLOBS, State, Ticket, no_such_job, not_yours, reused_key,
};
use super::connections::{Failure, all, execute, first, one};
use super::live::{Effects, LastWords, Live, end};
use super::replica::PostgresStore;
use super::rows::{self, column, count, jobs};
use crate::error::Result;

/// For how long counts of jobs are believed.
const COUNTS: Duration = Duration::from_secs(2);

/// A new job. `$8` is the limit of jobs that wait.
const CREATE: &str = "WITH job AS (\
    INSERT INTO jobs (id, tenant, state, spec, progress, urgency, idempotency_key, request_digest, last_seq) \
    SELECT $1::uuid, $2::text, 'queued', $3::json, $4::json, $5::smallint, $6::text, $7::text, 1 \
    WHERE (SELECT count(*) FROM (SELECT FROM jobs WHERE state = 'queued' LIMIT $8) AS waiting) < $8 \
    ON CONFLICT DO NOTHING RETURNING *\
), told AS (\
    INSERT INTO events (job, seq, kind, data) SELECT number, 1, 'state', 'queued' FROM job\
), kept AS (\
    INSERT INTO blobs (job, of_result, name, bytes) \
    SELECT job.number, false, b.name, b.bytes FROM job, unnest($9::text[], $10::bytea[]) AS b(name, bytes)\
) SELECT *, 1 + (SELECT count(*) FROM jobs WHERE state = 'queued' AND tenant = $2 AND urgency <= $5) AS queue_position \
FROM job";

impl PostgresStore {
    /// The job that a key stands for.
    async fn known(&self, tenant: &str, key: &str) -> Result<Option<(Job, String)>> {
        let found = self.connections.run(|client| async move {
            let row = first(&client, jobs!("WHERE tenant = $1 AND idempotency_key = $2"), &[&tenant, &key]).await?;
            let job = |row| Ok::<_, Failure>((rows::job(row)?, column(row, "request_digest")?));
            row.as_ref().map(job).transpose()
        });
        found.await
    }

    /// Whether a ticket ended its job with this end earlier: the answer to that was lost.
    async fn has_ended(&self, ticket: Ticket, end: &End) -> Result<bool> {
        let me = self.me;
        let found = self.connections.run(|client| async move {
            let sql = "SELECT state, boot FROM jobs WHERE id = $1 AND attempt = $2";
            let row = first(&client, sql, &[&ticket.job.uuid(), &(ticket.attempt as i32)]).await?;
            let is_same = |row| {
                Ok::<_, Failure>(rows::state(row)? == end.parts().0 && column::<Option<Uuid>>(row, "boot")? == Some(me))
            };
            row.as_ref().map(is_same).transpose()
        });
        Ok(found.await?.unwrap_or(false))
    }

    /// The error of a ticket that writes nothing.
    pub(super) async fn over(&self, ticket: Ticket) -> crate::Error {
        self.held.lock().remove(&ticket);
        match self.get(ticket.job).await {
            Ok(Some(_)) => not_yours(ticket.job),
            Ok(None) => no_such_job(ticket.job),
            Err(error) => error,
        }
    }
}

/// [`Kind::QueueFull`](crate::Kind) when as many jobs wait as may.
async fn check_room(client: &impl deadpool_postgres::GenericClient, rules: &Rules) -> Result<(), Failure> {
    let sql = "SELECT count(*) AS jobs FROM (SELECT FROM jobs WHERE state = 'queued' LIMIT $1) AS waiting";
    let most = i64::try_from(rules.max_queued).unwrap_or(i64::MAX);
    Ok(rules.check_room(count(&one(client, sql, &[&most]).await?, "jobs")?)?)
}

#[async_trait]
impl Queue for PostgresStore {
    async fn check_room(&self) -> Result<()> {
        self.connections.run(|client| async move { check_room(&client, &self.rules).await }).await
    }

    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        Ok(self.known(tenant, key).await?.is_some())
    }

    async fn create(&self, new: NewJob) -> Result<Created> {
        let NewJob { id, spec, idempotency, upload } = &new;
        let most = i64::try_from(self.rules.max_queued).unwrap_or(i64::MAX);
        let (key, request) = (
            idempotency.as_ref().map(|wanted| wanted.key.as_str()),
            idempotency.as_ref().map(|wanted| wanted.request.as_str()),
        );
        let names: Vec<&str> = upload.iter().map(|blob| blob.name.as_str()).collect();
        let bytes: Vec<&[u8]> = upload.iter().map(|blob| &blob.bytes[..]).collect();
        let (names, bytes) = (&names, &bytes);
        loop {
            if let Some(wanted) = idempotency
                && let Some((job, request)) = self.known(&spec.tenant, &wanted.key).await?
            {
                return match request == wanted.request {
                    true => Ok(Created::Known(job)),
                    false => Err(reused_key(&wanted.key)),
                };
            }
            let created = self.connections.run(|client| async move {
                let row = first(
                    &client,
                    CREATE,
                    &[
                        &id.uuid(),
                        &spec.tenant,
                        &Json(spec),
                        &Json(Progress::default()),
                        &-i16::from(spec.priority),
                        &key,
                        &request,
                        &most,
                        names,
                        bytes,
                    ],
                )
                .await?;
                match row {
                    Some(row) => Ok(Some(rows::job(&row)?)),
                    None => {
                        check_room(&client, &self.rules).await?;
                        Ok(None)
                    }
                }
            });
            if let Some(job) = created.await? {
                let pulse = Pulse { last_seq: 1, ..Pulse::default() };
                self.follow(&Effects { arrivals: true, pulses: vec![(*id, pulse)], ..Effects::default() });
                return Ok(Created::New(job));
            }
            // room was made in this moment, or the key came with another request; or this one was created before
            if let Some(job) = self.get(*id).await? {
                return Ok(Created::New(job));
            }
        }
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        let found = self.connections.run(|client| async move {
            let row = first(&client, jobs!("WHERE id = $1"), &[&id.uuid()]).await?;
            Ok(row.as_ref().map(rows::job).transpose()?)
        });
        found.await
    }

    async fn list(&self, list: &ListQuery) -> Result<Page> {
        let before = match &list.cursor {
            Some(cursor) => i64::try_from(self.cursors.number_of(cursor)?).unwrap_or(i64::MAX),
            None => i64::MAX,
        };
        // one more than the limit, to know whether there is another page
        let most = i64::try_from(list.limit).unwrap_or(i64::MAX).saturating_add(1);
        let found = self.connections.run(|client| async move {
            let (tenant, state) = (&list.tenant, list.state.map(State::name));
            let rows = match (tenant, state) {
                (None, None) => {
                    all(&client, jobs!("WHERE number < $1 ORDER BY number DESC LIMIT $2"), &[&before, &most]).await
                }
                (None, Some(state)) => {
                    let sql = jobs!("WHERE number < $1 AND state = $3 ORDER BY number DESC LIMIT $2");
                    all(&client, sql, &[&before, &most, &state]).await
                }
                (Some(tenant), None) => {
                    let sql = jobs!("WHERE number < $1 AND tenant = $3 ORDER BY number DESC LIMIT $2");
                    all(&client, sql, &[&before, &most, tenant]).await
                }
                (Some(tenant), Some(state)) => {
                    let sql = jobs!("WHERE number < $1 AND tenant = $3 AND state = $4 ORDER BY number DESC LIMIT $2");
                    all(&client, sql, &[&before, &most, tenant, &state]).await
                }
            };
            let numbered = |row| Ok((count(row, "number")?, rows::job(row)?));
            Ok(rows?.iter().map(numbered).collect::<Result<Vec<_>>>()?)
        });
        let mut found = found.await?;
        let has_more = found.len() > list.limit;
        found.truncate(list.limit);
        let next = found.last().filter(|_| has_more).map(|(number, _)| self.cursors.cursor_of(*number));
        Ok(Page { jobs: found.into_iter().map(|(_, job)| job).collect(), next })
    }

    async fn claim_as(&self, claiming: Claiming) -> Result<Vec<(Ticket, Job)>> {
        self.claim_jobs(&claiming).await
    }

    /// None: workers look every second.
    fn next_start(&self) -> Option<Duration> {
        None
    }

    async fn begin(&self, ticket: Ticket) -> Result<()> {
        let begun = self.connections.run(|client| async move {
            let sql = "UPDATE jobs SET begun = true WHERE id = $1 AND attempt = $2 AND state = 'running'";
            execute(&client, sql, &[&ticket.job.uuid(), &(ticket.attempt as i32)]).await
        });
        match begun.await? {
            0 => Err(self.over(ticket).await),
            _ => Ok(()),
        }
    }

    async fn retry(&self, id: JobId) -> Result<Retried> {
        let rules = self.rules;
        let retried = self.change(|transaction, effects| {
            Box::pin(async move {
                let Some(mut live) = Live::find(transaction, id).await? else { return Ok(Retried::Unknown) };
                if live.state != State::Failed {
                    return Ok(Retried::NotFailed(live.state));
                }
                check_room(transaction, &rules).await?;
                live.uncounted = live.attempt;
                live.cancel_requested = false;
                // a job that may kill its worker still starts alone, but at once
                live.suspicion = live.suspicion.min(ALONE_FROM);
                live.queue(transaction, Duration::ZERO, effects).await?;
                let job = one(transaction, jobs!("WHERE id = $1"), &[&id.uuid()]).await?;
                Ok(Retried::Queued(Box::new(rows::job(&job)?)))
            })
        });
        retried.await
    }

    async fn heartbeat(&self, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>> {
        let ids: Vec<Uuid> = tickets.iter().map(|ticket| ticket.job.uuid()).collect();
        let attempts: Vec<i32> = tickets.iter().map(|ticket| ticket.attempt as i32).collect();
        let (ids, attempts) = (&ids, &attempts);
        let kept = self.connections.run(|client| async move {
            let sql = "WITH kept AS (\
                UPDATE jobs SET lease_until = clock_timestamp() + make_interval(secs => $3) \
                FROM unnest($1::uuid[], $2::integer[]) AS mine(id, attempt) \
                WHERE jobs.id = mine.id AND jobs.attempt = mine.attempt AND jobs.state = 'running' \
                RETURNING jobs.id, jobs.attempt\
            ), alive AS (\
                UPDATE workers SET seen_at = clock_timestamp(), \
                    alive_until = greatest(alive_until, clock_timestamp() + make_interval(secs => $3)) WHERE id = $4\
            ) SELECT id, attempt FROM kept";
            let rows = all(&client, sql, &[ids, attempts, &lease.as_secs_f64(), &self.me]).await?;
            let ticket = |row| Ok(Ticket { job: rows::id(row, "id")?, attempt: rows::small(row, "attempt")? });
            Ok(rows.iter().map(ticket).collect::<Result<Vec<_>>>()?)
        });
        let kept = kept.await?;
        let lost: Vec<Ticket> = tickets.iter().filter(|ticket| !kept.contains(ticket)).copied().collect();
        self.held.lock().retain(|ticket, _| !lost.contains(ticket));
        Ok(lost)
    }

    async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        let rules = self.rules;
        let released = self.change(|transaction, effects| {
            let release = release.clone();
            Box::pin(async move {
                let live = Live::claimed(transaction, ticket).await?;
                live.release(transaction, &release, &rules, effects).await
            })
        });
        let released = released.await?;
        self.held.lock().remove(&ticket);
        Ok(released)
    }

    async fn reclaim(&self) -> Result<Vec<Ticket>> {
        self.give_back_lost().await
    }

    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        let ending = &ending;
        let (is_mine, effects) = self
            .connections
            .run(|client| async move {
                let mut effects = Effects::default();
                let Ending { end: how, rest, result } = ending;
                let words = LastWords { end: how, rest: rest.as_ref(), result, is_cancel: false };
                let is_mine = end(&client, ticket, State::Running, words, &mut effects).await?;
                Ok((is_mine, effects))
            })
            .await?;
        self.follow(&effects);
        let was_held = self.held.lock().remove(&ticket).is_some();
        match is_mine || was_held && self.has_ended(ticket, &ending.end).await? {
            true => Ok(()),
            false => Err(self.over(ticket).await),
        }
    }

    fn takes(&self, bytes: u64) -> bool {
        bytes <= SMALL_BLOBS
    }

    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        let found = self.connections.run(|client| async move {
            let sql = "SELECT bytes FROM blobs WHERE job = (SELECT number FROM jobs WHERE id = $1) AND name = $2 \
                       ORDER BY of_result DESC LIMIT 1";
            let row = first(&client, sql, &[&id.uuid(), &name]).await?;
            Ok(row.as_ref().map(|row| column::<Vec<u8>>(row, "bytes")).transpose()?)
        });
        Ok(found.await?.map(Bytes::from))
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        let cancelled = self.change(|transaction, effects| {
            Box::pin(async move {
                let Some(live) = Live::find(transaction, id).await? else { return Ok(None) };
                match live.state {
                    State::Queued => {
                        let words = LastWords { is_cancel: true, ..LastWords::from(&End::Cancelled) };
                        live.end(transaction, words, effects).await?;
                    }
                    State::Running => {
                        let sql = "UPDATE jobs SET cancel_requested = true WHERE id = $1";
                        execute(transaction, sql, &[&id.uuid()]).await?;
                        let pulse = Pulse { last_seq: live.last_seq, cancel_requested: true, ended: false };
                        effects.pulses.push((id, pulse));
                    }
                    State::Succeeded | State::Failed | State::Cancelled => {}
                }
                let row = one(transaction, jobs!("WHERE id = $1"), &[&id.uuid()]).await?;
                Ok(Some(rows::job(&row)?))
            })
        });
        cancelled.await
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        self.hints.arrivals.subscribe()
    }

    /// As of a moment ago.
    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        if let Some((at, counts)) = *self.counts.lock()
            && at.elapsed() < COUNTS
        {
            return Ok(counts);
        }
        let found = self.connections.run(|client| async move {
            let rows = all(&client, "SELECT state, count(*) AS jobs FROM jobs GROUP BY state", &[]).await?;
            let mut counts = [0; State::ALL.len()];
            for row in &rows {
                counts[rows::state(row)? as usize] = count(row, "jobs")?;
            }
            Ok(counts)
        });
        let counts = found.await?;
        *self.counts.lock() = Some((Instant::now(), counts));
        Ok(counts)
    }

    async fn waiting_of(&self, tenant: &str) -> Result<u64> {
        let found = self.connections.run(|client| async move {
            let sql = "SELECT count(*) AS waiting FROM jobs WHERE state = 'queued' AND tenant = $1";
            Ok(count(&one(&client, sql, &[&tenant]).await?, "waiting")?)
        });
        found.await
    }

    async fn oldest_queued(&self) -> Result<Option<SystemTime>> {
        let found = self.connections.run(|client| async move {
            let sql = "SELECT min(created_at) AS oldest FROM jobs WHERE state = 'queued'";
            Ok(column(&one(&client, sql, &[]).await?, "oldest")?)
        });
        found.await
    }
}
