//! Jobs in SQLite: for one process at a time, across restarts.
//!
//! Every change goes through the one [`writer`], as one of the [`commands`]; what only reads has connections of its own and
//! is never held up. The journal is a write-ahead log, and a commit returns when it is on the disk (`synchronous = FULL`):
//! what was answered survives a crash of the process, of the system, and of the power. Jobs that were running then are
//! released when the store is opened again, which counts as one of their attempts.
//!
//! What is asked of a job by value (its state, its tenant, when it ended) is a column; everything else is JSON, so that
//! the service can come to know more about jobs without another [`schema`]. Small blobs have a table of their own.

mod commands;
mod rows;
mod schema;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions as _, SqliteConnection, query};
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use self::commands::{
    Append, Cancel, Claim, Create, Delete, Finish, GiveBack, Heartbeat, Probe, Reclaim, SettleWebhook, waiting,
};
use self::rows::{column, count, jobs};
use self::writer::{Abort, Listeners, Writer};
use super::{
    Created, Deletion, Ending, Event, Job, JobId, JobStore, ListQuery, NewJob, Notice, Page, Progress, Pulse, Release,
    Rules, SMALL_BLOBS, State, Statistics, Ticket, What, cursor, queue_is_full,
};
use crate::error::{Error, Kind, Result};
use crate::service::faults::Faults;

/// Connections that read.
const READERS: u32 = 4;

/// Memory that a connection that reads keeps of the file, in KiB: four of them fill it in the first thousands of jobs, and
/// what they read is in the system's memory anyway.
const READ_CACHE: u32 = 512;

/// Size to which the write-ahead log is cut back after it grew larger.
const LOG_BYTES: u32 = 64 << 20;

/// A store in a file.
#[derive(Debug)]
pub(in crate::service) struct SqliteStore {
    rules: Rules,
    readers: SqlitePool,
    writer: Writer,
    listeners: Arc<Listeners>,
}

impl SqliteStore {
    /// Opens the store in the file at `path`, or makes it. Nobody else may have it open.
    pub async fn open(path: &Path, rules: Rules, faults: Faults) -> Result<Self> {
        let cannot = |error: &dyn std::fmt::Display| {
            Error::new(Kind::Io, format_args!("the store of jobs cannot be opened: {}: {error}", path.display()))
        };
        let options = SqliteConnectOptions::new()
            .filename(path)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .pragma("journal_size_limit", LOG_BYTES.to_string())
            .busy_timeout(Duration::from_secs(5))
            .disable_statement_logging();
        let connection = connect(options.clone().create_if_missing(true)).await.map_err(|error| cannot(&error))?;
        let connection = schema::migrate(connection).await.map_err(|error| cannot(&error))?;
        let reading = options.clone().read_only(true).pragma("cache_size", format!("-{READ_CACHE}"));
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            // a file in this process does not go away; to look costs each query a second one
            .test_before_acquire(false)
            .connect_with(reading)
            .await
            .map_err(|error| cannot(&error))?;
        let listeners = Arc::<Listeners>::default();
        let writer = Writer::start(connection, options, Arc::clone(&listeners), faults);
        let store = Self { rules, readers, writer, listeners };
        // Whoever ran them is no more.
        let interrupted = store.writer.carry_out(Reclaim { now: far_future(), rules }).await?;
        if !interrupted.is_empty() {
            tracing::warn!(jobs = interrupted.len(), "jobs were running when the service ended; they wait again");
        }
        Ok(store)
    }

    /// The rest of a page after the row `LIMIT`, as SQL: one text a filter, so that each has its index.
    fn list_sql(query: &ListQuery) -> &'static str {
        match (&query.tenant, query.state) {
            (None, None) => jobs!("WHERE number < ?1 ORDER BY number DESC LIMIT ?2"),
            (None, Some(_)) => jobs!("WHERE number < ?1 AND state = ?3 ORDER BY number DESC LIMIT ?2"),
            (Some(_), None) => jobs!("WHERE number < ?1 AND tenant = ?4 ORDER BY number DESC LIMIT ?2"),
            (Some(_), Some(_)) => {
                jobs!("WHERE number < ?1 AND tenant = ?4 AND state = ?3 ORDER BY number DESC LIMIT ?2")
            }
        }
    }
}

/// Opens a connection. By value, because rustc cannot see that futures over the borrowed options are `Send`.
async fn connect(options: SqliteConnectOptions) -> Result<SqliteConnection, sqlx::Error> {
    options.connect().await
}

fn far_future() -> SystemTime {
    rows::time(i64::MAX)
}

/// The error for what the database refuses: whether there is no room, or it cannot be reached, or something is broken.
fn database_error(error: sqlx::Error) -> Error {
    let primary =
        error.as_database_error().and_then(|error| error.code()?.parse::<u32>().ok()).map(|extended| extended & 0xff);
    let kind = match (&error, primary) {
        (sqlx::Error::Io(error), _) => Kind::of_storage(error),
        (_, Some(13)) => Kind::InsufficientStorage, // SQLITE_FULL
        // PERM, BUSY, LOCKED, NOMEM, READONLY, IOERR, CANTOPEN
        (_, Some(3 | 5 | 6 | 7 | 8 | 10 | 14)) => Kind::Unavailable,
        (sqlx::Error::PoolTimedOut | sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed, _) => Kind::Unavailable,
        _ => Kind::Internal,
    };
    Error::new(kind, format_args!("the store of jobs failed: {error}"))
}

impl From<Abort> for Error {
    fn from(abort: Abort) -> Self {
        match abort {
            Abort::Refused(error) => error,
            Abort::Broken(error) => database_error(error),
        }
    }
}

#[async_trait]
impl JobStore for SqliteStore {
    fn is_durable(&self) -> bool {
        true
    }

    async fn check_room(&self) -> Result<()> {
        let mut reader = self.readers.acquire().await.map_err(database_error)?;
        if waiting(&mut reader).await? >= self.rules.max_queued as u64 {
            return Err(queue_is_full(self.rules.max_queued));
        }
        Ok(())
    }

    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        let found = query("SELECT 1 FROM jobs WHERE tenant = ?1 AND idempotency_key = ?2")
            .bind(tenant)
            .bind(key)
            .fetch_optional(&self.readers)
            .await
            .map_err(database_error)?;
        Ok(found.is_some())
    }

    async fn create(&self, job: NewJob) -> Result<Created> {
        self.writer.carry_out(Create(job, self.rules)).await
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        let found = query(jobs!("WHERE id = ?1")).bind(id.to_string()).fetch_optional(&self.readers).await;
        found.map_err(database_error)?.map(|row| rows::job(&row)).transpose()
    }

    async fn list(&self, list: &ListQuery) -> Result<Page> {
        let before = match &list.cursor {
            Some(cursor) => i64::try_from(cursor::number_of(cursor)?).unwrap_or(i64::MAX),
            None => i64::MAX,
        };
        // one more than asked for tells whether there is another page
        let most = i64::try_from(list.limit).unwrap_or(i64::MAX).saturating_add(1);
        let mut found = query(Self::list_sql(list))
            .bind(before)
            .bind(most)
            .bind(list.state.map(State::name))
            .bind(&list.tenant)
            .fetch_all(&self.readers)
            .await
            .map_err(database_error)?;
        let has_more = found.len() > list.limit;
        found.truncate(list.limit);
        let last = found.last().map(|row| count(row, "number")).transpose()?;
        let jobs = found.iter().map(rows::job).collect::<Result<_>>()?;
        Ok(Page { jobs, next: last.filter(|_| has_more).map(cursor::cursor_of) })
    }

    async fn claim(&self, limit: usize, lease: Duration) -> Result<Vec<(Ticket, Job)>> {
        self.writer.carry_out(Claim { limit, lease }).await
    }

    async fn heartbeat(&self, tickets: &[Ticket], until: SystemTime) -> Result<Vec<Ticket>> {
        self.writer.carry_out(Heartbeat { tickets: tickets.to_vec(), until }).await
    }

    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        self.writer.carry_out(Append { ticket, events, progress }).await
    }

    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        self.writer.carry_out(Finish(ticket, ending)).await
    }

    fn takes(&self, bytes: u64) -> bool {
        bytes <= SMALL_BLOBS
    }

    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        let found = query("SELECT bytes FROM blobs WHERE job = (SELECT number FROM jobs WHERE id = ?1) AND name = ?2")
            .bind(id.to_string())
            .bind(name)
            .fetch_optional(&self.readers)
            .await;
        found.map_err(database_error)?.map(|row| Ok(column::<Vec<u8>>(&row, "bytes")?.into())).transpose()
    }

    async fn free_bytes(&self) -> Result<u64> {
        let found = query("SELECT freelist_count * page_size AS bytes FROM pragma_freelist_count, pragma_page_size")
            .fetch_one(&self.readers)
            .await;
        count(&found.map_err(database_error)?, "bytes")
    }

    async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        self.writer.carry_out(GiveBack(ticket, release, self.rules)).await
    }

    async fn reclaim(&self, now: SystemTime) -> Result<Vec<Ticket>> {
        self.writer.carry_out(Reclaim { now, rules: self.rules }).await
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        self.writer.carry_out(Cancel(id)).await
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        self.writer.carry_out(Delete(id)).await
    }

    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        let found = query("SELECT id FROM jobs WHERE ended_at < ?1 ORDER BY ended_at LIMIT ?2")
            .bind(rows::micros(time))
            .bind(i64::try_from(limit).unwrap_or(i64::MAX))
            .fetch_all(&self.readers)
            .await
            .map_err(database_error)?;
        found.iter().map(|row| column::<&str>(row, "id")?.parse()).collect()
    }

    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        let found = query("SELECT number FROM jobs WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await
            .map_err(database_error)?;
        let Some(row) = found else {
            return Ok(None);
        };
        let events = query("SELECT seq, kind, data FROM events WHERE job = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3")
            .bind(column::<i64>(&row, "number")?)
            .bind(i64::try_from(after).unwrap_or(i64::MAX))
            .bind(i64::try_from(limit).unwrap_or(i64::MAX))
            .fetch_all(&self.readers)
            .await
            .map_err(database_error)?;
        events.iter().map(rows::event).collect::<Result<_>>().map(Some)
    }

    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        let receiver = self.listeners.pulses.subscribe(id);
        let found = query("SELECT last_seq, cancel_requested, state FROM jobs WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await
            .map_err(database_error)?;
        let Some(row) = found else {
            return Ok(None);
        };
        let pulse = Pulse {
            last_seq: count(&row, "last_seq")?,
            cancel_requested: column(&row, "cancel_requested")?,
            ended: rows::state_of(column(&row, "state")?)?.is_ended(),
        };
        self.listeners.pulses.publish(id, pulse);
        Ok(Some(receiver))
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        let mut receiver = self.listeners.arrivals.subscribe();
        receiver.mark_changed();
        receiver
    }

    fn endings(&self) -> watch::Receiver<u64> {
        let mut receiver = self.listeners.endings.subscribe();
        receiver.mark_changed();
        receiver
    }

    async fn untold(&self) -> Result<Vec<JobId>> {
        let found = query("SELECT job FROM notices ORDER BY place").fetch_all(&self.readers).await;
        found.map_err(database_error)?.iter().map(|row| column::<&str>(row, "job")?.parse()).collect()
    }

    async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        let found =
            query("SELECT * FROM notices WHERE job = ?1").bind(id.to_string()).fetch_optional(&self.readers).await;
        found.map_err(database_error)?.map(|row| rows::notice(&row)).transpose()
    }

    async fn settle_webhook(&self, id: JobId) -> Result<()> {
        self.writer.carry_out(SettleWebhook(id)).await
    }

    async fn queued_of(&self, tenant: &str) -> Result<u64> {
        let found = query("SELECT count(*) AS jobs FROM jobs WHERE state = 'queued' AND tenant = ?1")
            .bind(tenant)
            .fetch_one(&self.readers)
            .await;
        count(&found.map_err(database_error)?, "jobs")
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        let found = query("SELECT state, count(*) AS jobs FROM jobs GROUP BY state").fetch_all(&self.readers).await;
        let mut counts = [0; State::ALL.len()];
        for row in found.map_err(database_error)? {
            let state = rows::state_of(column(&row, "state")?)?;
            for (count_of_state, _) in counts.iter_mut().zip(State::ALL).filter(|(_, other)| *other == state) {
                *count_of_state = count(&row, "jobs")?;
            }
        }
        Ok(counts)
    }

    async fn probe(&self) -> Result<()> {
        self.writer.carry_out(Probe).await
    }

    fn statistics(&self) -> Statistics {
        self.writer.counters.read()
    }

    async fn close(&self) {
        self.writer.close().await;
        self.readers.close().await;
    }
}

#[cfg(test)]
mod tests;
