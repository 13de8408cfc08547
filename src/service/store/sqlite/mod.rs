//! Jobs in SQLite: for one process at a time, across restarts.
//!
//! Every change is one of the [`commands`], which the one [`writer`] runs; reads have connections of their own and do
//! not wait for writes. The journal is a write-ahead log, and a commit returns when it is on the disk (`synchronous =
//! FULL`): answered changes survive a crash of the process, of the system, and of the power. When the store is opened
//! again, running jobs return to the queue ([`claim`]). In a temporary folder no commit waits for the disk.
//!
//! What queries select by (state, tenant, time of the end) is a column; everything else is JSON, so that a new field of
//! a job needs no new [`schema`]. Small blobs have a table of their own.

mod check;
mod claim;
mod claim_memory;
mod commands;
mod connections;
mod live;
mod opening;
mod rows;
mod schema;
mod uploads;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use rusqlite::{Connection, params};
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use self::check::Damage;
use self::claim::Recovered;
use self::connections::{Place, Readers, all, first, one};
use self::rows::{column, count, jobs};
use self::writer::{Batch, Listeners, Writer};
use super::cursor::Cursors;
use super::workers::OnlyWorker;
use super::{
    Claiming, Created, Deletion, Ending, Event, Events, Job, JobId, ListQuery, Maintenance, NewJob, Notice, Notices,
    Page, Presence, Progress, Pulse, Queue, Release, Retried, Rules, SMALL_BLOBS, State, Statistics, Ticket, What,
    Worker, Workers,
};
use crate::error::{Kind, Result};
use crate::service::blocking::blocking;
use crate::service::faults::Faults;

/// A store in a file.
#[derive(Debug)]
pub(in crate::service) struct SqliteStore {
    rules: Rules,
    readers: Arc<Readers>,
    writer: Writer,
    listeners: Arc<Listeners>,
    damage: Arc<Damage>,
    cursors: Cursors,
    place: Arc<Place>,
    worker: OnlyWorker,
}

impl SqliteStore {
    /// Opens the store in the file at `path`, or makes it. No other process may have it open.
    pub async fn open(path: &Path, rules: Rules, faults: Faults) -> Result<Self> {
        Self::open_place(Place::locked(path.to_owned())?, rules, faults).await
    }

    /// Makes a store in a file at `path` that the process does not outlast.
    pub async fn temporary(path: &Path, rules: Rules, faults: Faults) -> Result<Self> {
        Self::open_place(Place::temporary(path.to_owned()), rules, faults).await
    }

    async fn open_place(place: Place, rules: Rules, faults: Faults) -> Result<Self> {
        let place = Arc::new(place);
        let file = Arc::clone(&place);
        let (connection, readers, cursors) = blocking(move || opening::open(&file)).await??;
        let listeners = Arc::<Listeners>::default();
        let damage = Arc::clone(&readers.damage);
        let writer = Writer::start(connection, Arc::clone(&place), Arc::clone(&listeners), Arc::clone(&damage), faults);
        let writer = writer.map_err(|error| opening::cannot_open(&place.path, &error))?;
        let (readers, worker) = (Arc::new(readers), OnlyWorker::default());
        let store = Self { rules, readers, writer, listeners, damage, cursors, place, worker };
        // one process has the file: running jobs are those of a process that ended
        match store.writer.carry_out(move |batch| claim::recover(batch, &rules)).await {
            Ok(Recovered { unharmed: 0, suspects: 0, ended: 0 }) => {}
            Ok(Recovered { unharmed, suspects, ended }) => {
                let why = "the service did not stop in order; jobs that ran wait again";
                tracing::warn!(unharmed, suspects, ended, "{why}");
            }
            // their leases end
            Err(error) if error.kind == Kind::InsufficientStorage => {
                tracing::warn!(%error, "jobs that ran when the process died wait for room on the disk");
            }
            Err(error) => return Err(error),
        }
        Ok(store)
    }

    /// Lets other processes open the file again, when the disk has room for that.
    async fn share(&self) -> Result<()> {
        self.writer.carry_out(commands::probe).await?;
        // privacy ends with the last connection
        let readers = self.readers.pause().await;
        self.place.set_private(false);
        let close = |batch: &mut Batch<'_>| {
            batch.effects.reopens = true;
            Ok(())
        };
        let shared = async {
            self.writer.carry_out(close).await?;
            self.writer.carry_out(commands::probe).await
        };
        let shared = shared.await;
        self.place.set_private(shared.is_err());
        drop(readers);
        shared
    }

    /// Whether a job was ever added, deleted ones included.
    pub async fn was_used(&self) -> Result<bool> {
        let sql = "SELECT 1 FROM sqlite_sequence WHERE name = 'jobs' AND seq > 0";
        Ok(self.readers.read_much(move |reader| first(reader, sql, [], |_| Ok(()))).await?.is_some())
    }

    /// The SQL of a page, one text a filter, so that each has its index; and how many of these parameters it takes: the
    /// number before which the page begins, the most rows, the state, the tenant.
    fn list_sql(query: &ListQuery) -> (&'static str, usize) {
        match (&query.tenant, query.state) {
            (None, None) => (jobs!("WHERE number < ?1 ORDER BY number DESC LIMIT ?2"), 2),
            (None, Some(_)) => (jobs!("WHERE number < ?1 AND state = ?3 ORDER BY number DESC LIMIT ?2"), 3),
            (Some(_), None) => (jobs!("WHERE number < ?1 AND tenant = ?4 ORDER BY number DESC LIMIT ?2"), 4),
            (Some(_), Some(_)) => {
                (jobs!("WHERE number < ?1 AND tenant = ?4 AND state = ?3 ORDER BY number DESC LIMIT ?2"), 4)
            }
        }
    }
}

#[async_trait]
impl Queue for SqliteStore {
    async fn check_room(&self) -> Result<()> {
        self.readers.read(|reader| commands::check_room(reader, &self.rules)).await
    }

    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        let sql = "SELECT 1 FROM jobs WHERE tenant = ?1 AND idempotency_key = ?2";
        let found = self.readers.read(|reader| first(reader, sql, [tenant, key], |_| Ok(())));
        Ok(found.await?.is_some())
    }

    async fn create(&self, job: NewJob) -> Result<Created> {
        let rules = self.rules;
        self.writer.carry_out(move |batch| commands::create(batch, &job, &rules)).await
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        self.readers.read(|reader| commands::find(reader, id)).await
    }

    async fn list(&self, list: &ListQuery) -> Result<Page> {
        let before = match &list.cursor {
            Some(cursor) => i64::try_from(self.cursors.number_of(cursor)?).unwrap_or(i64::MAX),
            None => i64::MAX,
        };
        // one more than the limit, to know whether there is another page
        let most = i64::try_from(list.limit).unwrap_or(i64::MAX).saturating_add(1);
        let (sql, takes) = Self::list_sql(list);
        let (state, tenant) = (list.state.map(State::name), list.tenant.clone());
        let page = move |reader: &Connection| {
            let parameters = params![before, most, state, tenant];
            all(reader, sql, &parameters[..takes], |row| Ok((count(row, "number")?, rows::job(row)?)))
        };
        let mut found = self.readers.read_much(page).await?;
        let has_more = found.len() > list.limit;
        found.truncate(list.limit);
        let next = found.last().filter(|_| has_more).map(|(number, _)| self.cursors.cursor_of(*number));
        Ok(Page { jobs: found.into_iter().map(|(_, job)| job).collect(), next })
    }

    async fn claim_as(&self, claiming: Claiming) -> Result<Vec<(Ticket, Job)>> {
        let listeners = Arc::clone(&self.listeners);
        self.writer.carry_out(move |batch| claim::claim(batch, &claiming, &listeners.claims)).await
    }

    fn next_start(&self) -> Option<Duration> {
        self.listeners.claims.lock().next_start.map(|start| start.duration_since(rows::now()).unwrap_or_default())
    }

    async fn begin(&self, ticket: Ticket) -> Result<()> {
        self.writer.carry_out(move |batch| commands::begin(batch, ticket)).await
    }

    async fn retry(&self, id: JobId) -> Result<Retried> {
        let rules = self.rules;
        self.writer.carry_out(move |batch| commands::retry(batch, id, &rules)).await
    }

    async fn heartbeat(&self, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>> {
        let tickets = tickets.to_vec();
        self.writer.carry_out(move |batch| commands::heartbeat(batch, &tickets, lease)).await
    }

    async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        let rules = self.rules;
        self.writer.carry_out(move |batch| commands::release(batch, ticket, &release, &rules)).await
    }

    async fn reclaim(&self) -> Result<Vec<Ticket>> {
        let rules = self.rules;
        self.writer.carry_out(move |batch| commands::reclaim(batch, &rules)).await
    }

    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        self.writer.carry_out(move |batch| commands::end(batch, ticket, &ending)).await
    }

    fn takes(&self, bytes: u64) -> bool {
        bytes <= SMALL_BLOBS
    }

    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        if let Some(bytes) = self.listeners.uploads.lock().take(id, name) {
            return Ok(Some(bytes));
        }
        let name = name.to_owned();
        let read = move |reader: &Connection| {
            let sql = "SELECT bytes FROM blobs WHERE job = (SELECT number FROM jobs WHERE id = ?1) AND name = ?2";
            first(reader, sql, [id.to_string(), name], |row| column::<Vec<u8>>(row, "bytes"))
        };
        Ok(self.readers.read_much(read).await?.map(Bytes::from))
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        self.writer.carry_out(move |batch| commands::cancel(batch, id)).await
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        self.listeners.arrivals.subscribe()
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        let sql = "SELECT coalesce(sum(queued), 0) AS queued, coalesce(sum(running), 0) AS running, \
                   coalesce(sum(succeeded), 0) AS succeeded, coalesce(sum(failed), 0) AS failed, \
                   coalesce(sum(cancelled), 0) AS cancelled FROM tenants";
        let read = |row: &rusqlite::Row<'_>| {
            let mut counts = [0; State::ALL.len()];
            for (jobs, state) in counts.iter_mut().zip(State::ALL) {
                *jobs = count(row, state.name())?;
            }
            Ok(counts)
        };
        self.readers.read(|reader| one(reader, sql, [], read)).await
    }

    async fn waiting_of(&self, tenant: &str) -> Result<u64> {
        let sql = "SELECT coalesce((SELECT queued FROM tenants WHERE name = ?1), 0) AS waiting";
        self.readers.read(|reader| one(reader, sql, [tenant], |row| count(row, "waiting"))).await
    }

    async fn oldest_queued(&self) -> Result<Option<SystemTime>> {
        // by the index of the jobs that wait: without it, every row is read
        let sql = "SELECT min(created_at) AS oldest FROM jobs INDEXED BY jobs_waiting WHERE state = 'queued'";
        let read = |reader: &Connection| one(reader, sql, [], |row| column::<Option<i64>>(row, "oldest"));
        Ok(self.readers.read(read).await?.map(rows::time))
    }
}

#[async_trait]
impl Events for SqliteStore {
    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        self.writer.carry_out(move |batch| commands::append(batch, ticket, &events, &progress)).await
    }

    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        let after = i64::try_from(after).unwrap_or(i64::MAX);
        let limit = i64::try_from(limit).unwrap_or(i64::MAX);
        let read = move |reader: &Connection| {
            let sql = "SELECT number FROM jobs WHERE id = ?1";
            let Some(number) = first(reader, sql, [id.to_string()], |row| column::<i64>(row, "number"))? else {
                return Ok(None);
            };
            let sql = "SELECT seq, kind, data FROM events WHERE job = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3";
            all(reader, sql, [number, after, limit], rows::event).map(Some)
        };
        self.readers.read_much(read).await
    }

    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        let receiver = self.listeners.pulses.subscribe(id);
        if receiver.borrow().last_seq > 0 {
            // the last change of the job was published to another receiver
            return Ok(Some(receiver));
        }
        let sql = "SELECT last_seq, cancel_requested, state FROM jobs WHERE id = ?1";
        let read = |reader: &Connection| first(reader, sql, [id.to_string()], rows::pulse);
        let Some(pulse) = self.readers.read(read).await? else {
            return Ok(None);
        };
        self.listeners.pulses.publish(id, pulse);
        Ok(Some(receiver))
    }
}

#[async_trait]
impl Notices for SqliteStore {
    fn endings(&self) -> watch::Receiver<u64> {
        self.listeners.endings.subscribe()
    }

    async fn untold(&self) -> Result<Vec<JobId>> {
        let sql = "SELECT job FROM notices ORDER BY place";
        self.readers.read_much(move |reader| all(reader, sql, [], |row| rows::id(row, "job"))).await
    }

    async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        let sql = "SELECT * FROM notices WHERE job = ?1";
        self.readers.read(|reader| first(reader, sql, [id.to_string()], rows::notice)).await
    }

    async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()> {
        self.writer.carry_out(move |batch| commands::settle_webhook(batch, id, ended_at)).await
    }
}

#[async_trait]
impl Workers for SqliteStore {
    async fn announce(&self, presence: &Presence) -> Result<()> {
        self.worker.announce(presence);
        Ok(())
    }

    async fn workers(&self) -> Result<Vec<Worker>> {
        Ok(self.worker.worker(self).await?.into_iter().collect())
    }
}

#[async_trait]
impl Maintenance for SqliteStore {
    fn is_durable(&self) -> bool {
        !self.place.is_temporary
    }

    async fn free_bytes(&self) -> Result<u64> {
        let sql = "SELECT freelist_count * page_size AS bytes FROM pragma_freelist_count, pragma_page_size";
        self.readers.read(|reader| one(reader, sql, [], |row| count(row, "bytes"))).await
    }

    async fn give_back(&self) -> Result<()> {
        self.writer.carry_out(commands::give_back).await
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        self.writer.carry_out(move |batch| commands::delete(batch, id)).await
    }

    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        let limit = i64::try_from(limit).unwrap_or(i64::MAX);
        let sql = "SELECT id FROM jobs WHERE ended_at < ?1 ORDER BY ended_at LIMIT ?2";
        let read = move |reader: &Connection| all(reader, sql, [rows::micros(time), limit], |row| rows::id(row, "id"));
        self.readers.read_much(read).await
    }

    async fn probe(&self) -> Result<()> {
        match self.damage.found() {
            Some(error) => Err(error),
            None if self.place.is_private() => self.share().await,
            None => self.writer.carry_out(commands::probe).await,
        }
    }

    fn statistics(&self) -> Statistics {
        let written = self.writer.counters.read();
        // reads find damage, too
        Statistics { failures: written.failures + u64::from(self.damage.found().is_some()), ..written }
    }

    async fn close(&self) {
        // readers first: the last connection to close empties the log
        self.readers.close().await;
        self.writer.close().await;
        self.place.release();
    }
}

#[cfg(test)]
mod tests;
