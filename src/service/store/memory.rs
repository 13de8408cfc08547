//! Jobs in memory: for one process, until it ends. Nothing here is durable.
//!
//! One lock around everything, held for look-ups only and never across an await.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use super::cursor::Cursors;
use super::fairness::{Turns, Waiting, first_tenants};
use super::{
    Claiming, Created, Deletion, End, Ending, Event, Events, Idempotency, Job, JobId, ListQuery, Maintenance, NewJob,
    Notice, Notices, Page, Progress, Pulse, Queue, Release, Retried, Rules, SMALL_BLOBS, SmallBlob, State, Statistics,
    Ticket, What, given_up, lease_is_over, no_such_job, not_yours, queue_is_full, reused_key,
};
use crate::error::{Kind, Result};

/// Bytes of all small blobs at the most: what comes after that goes to files.
const BLOBS: u64 = 64 << 20;

/// A store that forgets everything when the process ends.
#[derive(Debug)]
pub(in crate::service) struct MemoryStore {
    rules: Rules,
    inner: Mutex<Inner>,
    cursors: Cursors,
    arrivals: watch::Sender<u64>,
    endings: watch::Sender<u64>,
    /// Whether the last claim passed over a waiting job that another job's end may free.
    has_held_back: AtomicBool,
}

#[derive(Debug, Default)]
struct Inner {
    jobs: HashMap<JobId, Entry>,
    /// Jobs by their number, which counts the jobs ever created.
    numbers: BTreeMap<u64, JobId>,
    /// The queue of each tenant that has ever had a job.
    queues: BTreeMap<String, TenantQueue>,
    turns: Turns,
    /// Ended jobs by the time of their end.
    ended: BTreeSet<(SystemTime, JobId)>,
    /// Jobs by tenant and key.
    keys: HashMap<(String, String), JobId>,
    created: u64,
    /// Ends whose webhook was not settled, in their order.
    untold: Vec<Notice>,
    /// Bytes of all small blobs.
    blob_bytes: u64,
    /// As in [`Statistics`].
    attempts_failed: u64,
    /// As in [`Statistics`].
    given_up: u64,
}

/// The live jobs of a tenant.
#[derive(Debug, Default)]
struct TenantQueue {
    /// Priority, negated, and number of those that wait: the first is claimed first.
    waiting: BTreeSet<(i16, u64)>,
    running: u64,
}

#[derive(Debug)]
struct Entry {
    number: u64,
    job: Job,
    /// Attempts that do not count.
    uncounted: u32,
    /// Whether the current attempt counts.
    has_begun: bool,
    lease_until: SystemTime,
    idempotency: Option<Idempotency>,
    blobs: Vec<SmallBlob>,
    events: Vec<Event>,
    pulse: watch::Sender<Pulse>,
}

impl MemoryStore {
    /// An empty store.
    pub fn new(rules: Rules) -> Result<Self> {
        Ok(Self {
            rules,
            inner: Mutex::default(),
            cursors: Cursors::random()?,
            arrivals: watch::Sender::default(),
            endings: watch::Sender::default(),
            has_held_back: AtomicBool::default(),
        })
    }

    /// The state; it is whole at every moment in which a holder of the lock could panic.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends a job.
    fn end_job(&self, inner: &mut Inner, id: JobId, end: End) {
        inner.leave_queue(id);
        if !matches!(&end, End::Failed(error) if error.kind == Kind::Poison) {
            inner.keep(id, Vec::new());
        }
        if self.has_held_back.load(Ordering::Relaxed) {
            self.arrivals.send_modify(|count| *count += 1);
        }
        let Some(entry) = inner.jobs.get_mut(&id) else { return };
        let ended_at = SystemTime::now();
        entry.job.ended_at = Some(ended_at);
        match end {
            End::Succeeded(summary) => {
                entry.job.state = State::Succeeded;
                entry.job.summary = Some(summary);
            }
            End::Failed(error) => {
                entry.job.state = State::Failed;
                entry.job.problem = Some(error);
            }
            End::Cancelled => entry.job.state = State::Cancelled,
        }
        entry.append([What::End(entry.job.state, entry.job.problem.clone())]);
        inner.ended.insert((ended_at, id));
        if let Some(webhook) = entry.job.spec.webhook.clone() {
            inner.untold.retain(|notice| notice.job != id);
            inner.untold.push(Notice {
                job: id,
                webhook,
                trace_parent: entry.job.spec.trace_parent.clone(),
                state: entry.job.state,
                problem: entry.job.problem.clone(),
                ended_at,
                end: entry.events.iter().filter(|event| matches!(event.what, What::End(..))).count() as u32,
            });
            self.endings.send_modify(|count| *count += 1);
        }
    }

    /// Gives a running job back.
    fn give_back(&self, inner: &mut Inner, id: JobId, release: Release) -> State {
        let Some(entry) = inner.jobs.get_mut(&id) else { return State::Cancelled };
        let counted = entry.job.attempt.saturating_sub(entry.uncounted);
        match release {
            _ if entry.job.cancel_requested => {
                self.end_job(inner, id, End::Cancelled);
                return State::Cancelled;
            }
            Release::Failed(error) if entry.has_begun && counted >= self.rules.max_attempts => {
                self.end_job(inner, id, End::Failed(given_up(counted.into(), &error)));
                return State::Failed;
            }
            Release::Failed(_) if entry.has_begun => {}
            Release::Failed(_) | Release::Free => entry.uncounted += 1,
        }
        self.queue(inner, id);
        State::Queued
    }

    /// Puts a job that does not wait into the queue.
    fn queue(&self, inner: &mut Inner, id: JobId) {
        inner.leave_queue(id);
        let Some(entry) = inner.jobs.get_mut(&id) else { return };
        entry.job.state = State::Queued;
        entry.append([What::State(State::Queued)]);
        let place = entry.place();
        inner.queues.entry(entry.job.spec.tenant.clone()).or_default().waiting.insert(place);
        self.arrivals.send_modify(|count| *count += 1);
    }

    /// [`Kind::QueueFull`] when as many jobs wait as may.
    fn check_queue(&self, inner: &Inner) -> Result<()> {
        match inner.waiting() < self.rules.max_queued {
            true => Ok(()),
            false => Err(queue_is_full(self.rules.max_queued)),
        }
    }
}

impl Inner {
    /// The job as it is told to others, with its place in the queue.
    fn tell(&self, entry: &Entry) -> Job {
        let mut job = entry.job.clone();
        let queue = self.queues.get(&job.spec.tenant).filter(|_| job.state == State::Queued);
        job.queue_position = queue.map(|queue| queue.waiting.range(..=entry.place()).count() as u64);
        job
    }

    /// Number of jobs that wait.
    fn waiting(&self) -> usize {
        self.queues.values().map(|queue| queue.waiting.len()).sum()
    }

    /// Takes a live job out of its tenant's queue, before its state changes.
    fn leave_queue(&mut self, id: JobId) {
        let Some(entry) = self.jobs.get(&id) else { return };
        let Some(queue) = self.queues.get_mut(&entry.job.spec.tenant) else { return };
        match entry.job.state {
            State::Queued => {
                queue.waiting.remove(&entry.place());
            }
            State::Running => queue.running -= 1,
            State::Succeeded | State::Failed | State::Cancelled => {}
        }
    }

    /// The waiting job that is claimed next, if any may be.
    fn next(&self, claiming: &Claiming, newcomers: bool) -> Option<JobId> {
        let queues = self.queues.iter().filter(|(_, queue)| !queue.waiting.is_empty());
        let waiting: Vec<_> =
            queues.map(|(tenant, queue)| Waiting { tenant: tenant.clone(), running: queue.running }).collect();
        let first = first_tenants(&waiting, &self.turns, &claiming.shares, newcomers);
        let heads = first.iter().filter_map(|&index| self.queues[&waiting[index].tenant].waiting.first());
        self.numbers.get(&heads.min()?.1).copied()
    }

    /// Replaces the small blobs of a job.
    fn keep(&mut self, id: JobId, blobs: Vec<SmallBlob>) {
        let bytes = |blobs: &[SmallBlob]| blobs.iter().map(|blob| blob.bytes.len() as u64).sum::<u64>();
        if let Some(entry) = self.jobs.get_mut(&id) {
            self.blob_bytes = self.blob_bytes + bytes(&blobs) - bytes(&entry.blobs);
            entry.blobs = blobs;
        }
    }

    /// The running job that a ticket is valid for.
    fn claimed(&mut self, ticket: Ticket) -> Result<&mut Entry> {
        let entry = self.jobs.get_mut(&ticket.job).ok_or_else(|| no_such_job(ticket.job))?;
        if !entry.is_held_by(ticket) {
            return Err(not_yours(ticket.job));
        }
        Ok(entry)
    }
}

impl Entry {
    /// Its place among the waiting jobs of its tenant.
    fn place(&self) -> (i16, u64) {
        (-i16::from(self.job.spec.priority), self.number)
    }

    fn is_held_by(&self, ticket: Ticket) -> bool {
        self.job.state == State::Running && self.job.attempt == ticket.attempt
    }

    /// Appends events and wakes those who wait.
    fn append(&mut self, events: impl IntoIterator<Item = What>) {
        for what in events {
            let seq = self.events.len() as u64 + 1;
            self.events.push(Event { seq, what });
        }
        self.pulse.send_replace(Pulse {
            last_seq: self.events.len() as u64,
            cancel_requested: self.job.cancel_requested,
            ended: self.job.state.is_ended(),
        });
    }
}

#[async_trait]
impl Queue for MemoryStore {
    async fn check_room(&self) -> Result<()> {
        self.check_queue(&self.lock())
    }

    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        Ok(self.lock().keys.contains_key(&(tenant.to_owned(), key.to_owned())))
    }

    async fn create(&self, new: NewJob) -> Result<Created> {
        let NewJob { id, spec, idempotency, upload } = new;
        let mut inner = self.lock();
        let key = idempotency.as_ref().map(|wanted| (spec.tenant.clone(), wanted.key.clone()));
        if let Some(known) = key.as_ref().and_then(|key| inner.jobs.get(inner.keys.get(key)?)) {
            return match known.idempotency == idempotency {
                true => Ok(Created::Known(inner.tell(known))),
                false => Err(reused_key(idempotency.as_ref().map_or("", |wanted| &wanted.key))),
            };
        }
        self.check_queue(&inner)?;
        inner.created += 1;
        let number = inner.created;
        let created_at = SystemTime::now();
        let mut entry = Entry {
            number,
            job: Job {
                id,
                state: State::Queued,
                spec,
                queue_position: None,
                attempt: 0,
                worker: None,
                progress: Progress::default(),
                cancel_requested: false,
                problem: None,
                summary: None,
                created_at,
                started_at: None,
                ended_at: None,
            },
            uncounted: 0,
            has_begun: false,
            lease_until: created_at,
            idempotency,
            blobs: Vec::new(),
            events: Vec::new(),
            pulse: watch::Sender::default(),
        };
        entry.append([What::State(State::Queued)]);
        inner.queues.entry(entry.job.spec.tenant.clone()).or_default().waiting.insert(entry.place());
        inner.numbers.insert(number, id);
        if let Some(key) = key {
            inner.keys.insert(key, id);
        }
        let job = inner.tell(&entry);
        inner.jobs.insert(id, entry);
        inner.keep(id, upload);
        self.arrivals.send_modify(|count| *count += 1);
        Ok(Created::New(job))
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        let inner = self.lock();
        Ok(inner.jobs.get(&id).map(|entry| inner.tell(entry)))
    }

    async fn list(&self, query: &ListQuery) -> Result<Page> {
        let before = match &query.cursor {
            Some(cursor) => self.cursors.number_of(cursor)?,
            None => u64::MAX,
        };
        let inner = self.lock();
        let mut entries = inner
            .numbers
            .range(..before)
            .rev()
            .filter_map(|(_, id)| inner.jobs.get(id))
            .filter(|entry| query.tenant.as_ref().is_none_or(|tenant| entry.job.spec.tenant == *tenant))
            .filter(|entry| query.state.is_none_or(|state| entry.job.state == state));
        let mut page = Page::default();
        let mut last = before;
        for entry in entries.by_ref().take(query.limit) {
            page.jobs.push(inner.tell(entry));
            last = entry.number;
        }
        page.next = entries.next().map(|_| self.cursors.cursor_of(last));
        Ok(page)
    }

    async fn claim_as(&self, claiming: Claiming) -> Result<Vec<(Ticket, Job)>> {
        let mut inner = self.lock();
        let inner = &mut *inner;
        let now = SystemTime::now();
        let mut claimed = Vec::new();
        while claimed.len() < claiming.limit + claiming.newcomers {
            let Some(id) = inner.next(&claiming, claimed.len() >= claiming.limit) else { break };
            inner.leave_queue(id);
            let Some(entry) = inner.jobs.get_mut(&id) else { continue };
            let tenant = entry.job.spec.tenant.clone();
            entry.job.attempt += 1;
            entry.job.state = State::Running;
            entry.job.started_at = Some(now);
            entry.job.worker = Some(claiming.worker.to_string());
            entry.lease_until = now + claiming.lease;
            entry.has_begun = entry.job.spec.is_small;
            entry.append([What::Started(entry.job.attempt, claiming.worker.to_string())]);
            claimed.push((Ticket { job: id, attempt: entry.job.attempt }, entry.job.clone()));
            inner.turns.serve(&tenant);
            inner.turns.charge(&tenant, 1.0, claiming.shares.of(&tenant));
            inner.queues.entry(tenant).or_default().running += 1;
        }
        self.has_held_back.store(inner.waiting() > 0, Ordering::Relaxed);
        Ok(claimed)
    }

    fn next_start(&self) -> Option<Duration> {
        None
    }

    async fn begin(&self, ticket: Ticket) -> Result<()> {
        self.lock().claimed(ticket)?.has_begun = true;
        Ok(())
    }

    async fn retry(&self, id: JobId) -> Result<Retried> {
        let mut inner = self.lock();
        let inner = &mut *inner;
        let has_room = self.check_queue(inner);
        let Some(entry) = inner.jobs.get_mut(&id) else { return Ok(Retried::Unknown) };
        if entry.job.state != State::Failed {
            return Ok(Retried::NotFailed(entry.job.state));
        }
        has_room?;
        entry.uncounted = entry.job.attempt;
        let ended_at = entry.job.ended_at.take();
        (entry.job.problem, entry.job.cancel_requested) = (None, false);
        if let Some(ended_at) = ended_at {
            inner.ended.remove(&(ended_at, id));
        }
        self.queue(inner, id);
        Ok(inner.jobs.get(&id).map_or(Retried::Unknown, |entry| Retried::Queued(Box::new(inner.tell(entry)))))
    }

    async fn heartbeat(&self, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>> {
        let until = SystemTime::now() + lease;
        let mut inner = self.lock();
        let mut lost = Vec::new();
        for ticket in tickets {
            match inner.jobs.get_mut(&ticket.job).filter(|entry| entry.is_held_by(*ticket)) {
                Some(entry) => entry.lease_until = until,
                None => lost.push(*ticket),
            }
        }
        Ok(lost)
    }

    async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        let mut inner = self.lock();
        inner.claimed(ticket)?;
        Ok(self.give_back(&mut inner, ticket.job, release))
    }

    async fn reclaim(&self) -> Result<Vec<Ticket>> {
        let now = SystemTime::now();
        let mut inner = self.lock();
        let mut over: Vec<(u64, Ticket)> = inner
            .jobs
            .values()
            .filter(|entry| entry.job.state == State::Running && entry.lease_until <= now)
            .map(|entry| (entry.number, Ticket { job: entry.job.id, attempt: entry.job.attempt }))
            .collect();
        over.sort_by_key(|(number, _)| *number);
        for (_, ticket) in &over {
            let has_begun = inner.jobs.get(&ticket.job).is_some_and(|entry| entry.has_begun);
            let state = self.give_back(&mut inner, ticket.job, Release::Failed(lease_is_over()));
            inner.attempts_failed += u64::from(has_begun);
            inner.given_up += u64::from(state == State::Failed);
        }
        Ok(over.into_iter().map(|(_, ticket)| ticket).collect())
    }

    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        let mut inner = self.lock();
        let entry = inner.claimed(ticket)?;
        if let Some((events, progress)) = ending.rest {
            entry.job.progress = progress;
            entry.append(events);
        }
        self.end_job(&mut inner, ticket.job, ending.end);
        if !ending.result.is_empty() {
            inner.keep(ticket.job, ending.result);
        }
        Ok(())
    }

    fn takes(&self, bytes: u64) -> bool {
        bytes <= SMALL_BLOBS && self.lock().blob_bytes + bytes <= BLOBS
    }

    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        let inner = self.lock();
        let blob = inner.jobs.get(&id).and_then(|entry| entry.blobs.iter().find(|blob| blob.name == name));
        Ok(blob.map(|blob| blob.bytes.clone()))
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        let mut inner = self.lock();
        let inner = &mut *inner;
        let Some(entry) = inner.jobs.get_mut(&id) else {
            return Ok(None);
        };
        match entry.job.state {
            State::Queued => {
                entry.job.cancel_requested = true;
                self.end_job(inner, id, End::Cancelled);
            }
            State::Running => {
                entry.job.cancel_requested = true;
                entry.append([]);
            }
            State::Succeeded | State::Failed | State::Cancelled => {}
        }
        Ok(inner.jobs.get(&id).map(|entry| entry.job.clone()))
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        let mut receiver = self.arrivals.subscribe();
        receiver.mark_changed();
        receiver
    }

    async fn queued_of(&self, tenant: &str) -> Result<u64> {
        Ok(self.lock().queues.get(tenant).map_or(0, |queue| queue.waiting.len() as u64))
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        let inner = self.lock();
        Ok(State::ALL.map(|state| inner.jobs.values().filter(|entry| entry.job.state == state).count() as u64))
    }

    async fn oldest_queued(&self) -> Result<Option<SystemTime>> {
        let inner = self.lock();
        let waiting = inner.jobs.values().filter(|entry| entry.job.state == State::Queued);
        Ok(waiting.map(|entry| entry.job.created_at).min())
    }
}

#[async_trait]
impl Events for MemoryStore {
    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        let mut inner = self.lock();
        let entry = inner.claimed(ticket)?;
        entry.job.progress = progress;
        entry.append(events);
        Ok(())
    }

    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        let inner = self.lock();
        Ok(inner.jobs.get(&id).map(|entry| {
            let first = usize::try_from(after).unwrap_or(usize::MAX).min(entry.events.len());
            let end = first.saturating_add(limit).min(entry.events.len());
            entry.events[first..end].to_vec()
        }))
    }

    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        let inner = self.lock();
        Ok(inner.jobs.get(&id).map(|entry| entry.pulse.subscribe()))
    }
}

#[async_trait]
impl Notices for MemoryStore {
    fn endings(&self) -> watch::Receiver<u64> {
        let mut receiver = self.endings.subscribe();
        receiver.mark_changed();
        receiver
    }

    async fn untold(&self) -> Result<Vec<JobId>> {
        Ok(self.lock().untold.iter().map(|notice| notice.job).collect())
    }

    async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        Ok(self.lock().untold.iter().find(|notice| notice.job == id).cloned())
    }

    async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()> {
        self.lock().untold.retain(|notice| (notice.job, notice.ended_at) != (id, ended_at));
        Ok(())
    }
}

#[async_trait]
impl Maintenance for MemoryStore {
    fn is_durable(&self) -> bool {
        false
    }

    async fn free_bytes(&self) -> Result<u64> {
        Ok(0)
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        let mut inner = self.lock();
        let inner = &mut *inner;
        match inner.jobs.get(&id) {
            None => return Ok(Deletion::Unknown),
            Some(entry) if !entry.job.state.is_ended() => return Ok(Deletion::Live),
            Some(_) => {}
        }
        inner.keep(id, Vec::new());
        if let Some(entry) = inner.jobs.remove(&id) {
            inner.numbers.remove(&entry.number);
            if let Some(ended_at) = entry.job.ended_at {
                inner.ended.remove(&(ended_at, id));
            }
            if let Some(wanted) = entry.idempotency {
                inner.keys.remove(&(entry.job.spec.tenant, wanted.key));
            }
        }
        Ok(Deletion::Deleted)
    }

    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        let inner = self.lock();
        Ok(inner.ended.iter().take_while(|(ended_at, _)| *ended_at < time).take(limit).map(|(_, id)| *id).collect())
    }

    async fn probe(&self) -> Result<()> {
        Ok(())
    }

    fn statistics(&self) -> Statistics {
        let inner = self.lock();
        Statistics { attempts_failed: inner.attempts_failed, given_up: inner.given_up, ..Statistics::default() }
    }

    async fn close(&self) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::store::JobStore;
    use crate::service::store::conformance::{self, Subject};

    struct InMemory;

    #[async_trait]
    impl Subject for InMemory {
        async fn empty(&self, rules: Rules) -> Box<dyn JobStore> {
            Box::new(MemoryStore::new(rules).expect("made"))
        }
    }

    #[tokio::test]
    async fn conforms() {
        conformance::run(&InMemory).await;
    }
}
