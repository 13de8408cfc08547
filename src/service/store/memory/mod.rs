//! Jobs in memory: for one process, until it ends. Nothing here is durable.
//!
//! One lock around everything, held for look-ups only and never across an await.

mod jobs;

use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use parking_lot::Mutex;
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use self::jobs::{Entry, Jobs};
use super::cursor::Cursors;
use super::workers::{OneProcess, OnlyWorker};
use super::{
    Claiming, Created, Deletion, End, Ending, Event, Events, Job, JobId, ListQuery, Maintenance, NewJob, Notice,
    Notices, Page, Progress, Pulse, Queue, Release, Retried, Rules, SMALL_BLOBS, State, Statistics, Ticket, What,
    lease_is_over, reused_key,
};
use crate::error::Result;

/// Bytes of all small blobs at the most: what comes after that goes to files.
const BLOBS: u64 = 64 << 20;

/// A store that forgets everything when the process ends.
#[derive(Debug)]
pub(in crate::service) struct MemoryStore {
    jobs: Mutex<Jobs>,
    cursors: Cursors,
    worker: OnlyWorker,
}

impl MemoryStore {
    /// An empty store.
    pub fn new(rules: Rules) -> Result<Self> {
        Ok(Self { jobs: Mutex::new(Jobs::new(rules)), cursors: Cursors::random()?, worker: OnlyWorker::default() })
    }
}

impl OneProcess for MemoryStore {
    fn only_worker(&self) -> &OnlyWorker {
        &self.worker
    }

    fn look_again(&self) {
        self.jobs.lock().arrivals.notify();
    }
}

#[async_trait]
impl Queue for MemoryStore {
    async fn check_room(&self) -> Result<()> {
        let jobs = self.jobs.lock();
        jobs.rules.check_room(jobs.waiting())
    }

    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        Ok(self.jobs.lock().keys.contains_key(&(tenant.to_owned(), key.to_owned())))
    }

    async fn create(&self, new: NewJob) -> Result<Created> {
        let NewJob { id, spec, idempotency, upload } = new;
        let mut jobs = self.jobs.lock();
        let key = idempotency.as_ref().map(|wanted| (spec.tenant.clone(), wanted.key.clone()));
        if let Some(known) = key.as_ref().and_then(|key| jobs.by_id.get(jobs.keys.get(key)?)) {
            return match known.idempotency == idempotency {
                true => Ok(Created::Known(jobs.with_place(known))),
                false => Err(reused_key(idempotency.as_ref().map_or("", |wanted| &wanted.key))),
            };
        }
        jobs.rules.check_room(jobs.waiting())?;
        jobs.created += 1;
        let number = jobs.created;
        let created_at = SystemTime::now();
        let entry = Entry {
            number,
            job: Job::queued(id, spec, created_at),
            uncounted: 0,
            has_begun: false,
            lease_until: created_at,
            idempotency,
            blobs: Vec::new(),
            events: Vec::new(),
            pulse: watch::Sender::default(),
        };
        jobs.by_id.insert(id, entry);
        jobs.numbers.insert(number, id);
        if let Some(key) = key {
            jobs.keys.insert(key, id);
        }
        jobs.keep(id, upload);
        jobs.queue(id);
        Ok(Created::New(jobs.with_place(&jobs.by_id[&id])))
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        let jobs = self.jobs.lock();
        Ok(jobs.by_id.get(&id).map(|entry| jobs.with_place(entry)))
    }

    async fn list(&self, query: &ListQuery) -> Result<Page> {
        let before = match &query.cursor {
            Some(cursor) => self.cursors.number_of(cursor)?,
            None => u64::MAX,
        };
        let jobs = self.jobs.lock();
        let mut entries = jobs
            .numbers
            .range(..before)
            .rev()
            .filter_map(|(_, id)| jobs.by_id.get(id))
            .filter(|entry| query.tenant.as_ref().is_none_or(|tenant| entry.job.spec.tenant == *tenant))
            .filter(|entry| query.state.is_none_or(|state| entry.job.state == state));
        let mut page = Page::default();
        let mut last = before;
        for entry in entries.by_ref().take(query.limit) {
            page.jobs.push(jobs.with_place(entry));
            last = entry.number;
        }
        page.next = entries.next().map(|_| self.cursors.cursor_of(last));
        Ok(page)
    }

    async fn claim_as(&self, claiming: Claiming) -> Result<Vec<(Ticket, Job)>> {
        if self.worker.drains() {
            return Ok(Vec::new());
        }
        let jobs = &mut *self.jobs.lock();
        let now = SystemTime::now();
        let mut claimed = Vec::new();
        while claimed.len() < claiming.limit + claiming.newcomers {
            let Some(id) = jobs.next(&claiming, claimed.len() >= claiming.limit) else { break };
            jobs.leave_queue(id);
            let Some(entry) = jobs.by_id.get_mut(&id) else { continue };
            let tenant = entry.job.spec.tenant.clone();
            entry.job.attempt += 1;
            entry.job.state = State::Running;
            entry.job.started_at = Some(now);
            entry.job.worker = Some(claiming.worker.to_string());
            entry.lease_until = now + claiming.lease;
            entry.has_begun = entry.job.spec.is_small;
            entry.append([What::Started(entry.job.attempt, claiming.worker.to_string())]);
            claimed.push((Ticket { job: id, attempt: entry.job.attempt }, entry.job.clone()));
            jobs.virtual_times.serve(&tenant);
            jobs.virtual_times.charge(&tenant, 1.0, claiming.shares.of(&tenant));
            jobs.queues.entry(tenant).or_default().running += 1;
        }
        jobs.has_held_back = jobs.waiting() > 0;
        Ok(claimed)
    }

    fn next_start(&self) -> Option<Duration> {
        None
    }

    async fn begin(&self, ticket: Ticket) -> Result<()> {
        self.jobs.lock().claimed(ticket)?.has_begun = true;
        Ok(())
    }

    async fn retry(&self, id: JobId) -> Result<Retried> {
        let jobs = &mut *self.jobs.lock();
        let has_room = jobs.rules.check_room(jobs.waiting());
        let Some(entry) = jobs.by_id.get_mut(&id) else { return Ok(Retried::Unknown) };
        if entry.job.state != State::Failed {
            return Ok(Retried::NotFailed(entry.job.state));
        }
        has_room?;
        entry.uncounted = entry.job.attempt;
        let ended_at = entry.job.ended_at.take();
        (entry.job.problem, entry.job.cancel_requested) = (None, false);
        if let Some(ended_at) = ended_at {
            jobs.ended.remove(&(ended_at, id));
        }
        jobs.queue(id);
        Ok(jobs.by_id.get(&id).map_or(Retried::Unknown, |entry| Retried::Queued(Box::new(jobs.with_place(entry)))))
    }

    async fn heartbeat(&self, tickets: &[Ticket], lease: Duration) -> Result<Vec<Ticket>> {
        let until = SystemTime::now() + lease;
        let mut jobs = self.jobs.lock();
        let mut lost = Vec::new();
        for ticket in tickets {
            match jobs.by_id.get_mut(&ticket.job).filter(|entry| entry.is_held_by(*ticket)) {
                Some(entry) => entry.lease_until = until,
                None => lost.push(*ticket),
            }
        }
        Ok(lost)
    }

    async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        let mut jobs = self.jobs.lock();
        jobs.claimed(ticket)?;
        Ok(jobs.give_back(ticket.job, release))
    }

    async fn reclaim(&self) -> Result<Vec<Ticket>> {
        let now = SystemTime::now();
        let mut jobs = self.jobs.lock();
        let mut over: Vec<(u64, Ticket)> = jobs
            .by_id
            .values()
            .filter(|entry| entry.job.state == State::Running && entry.lease_until <= now)
            .map(|entry| (entry.number, Ticket { job: entry.job.id, attempt: entry.job.attempt }))
            .collect();
        over.sort_by_key(|(number, _)| *number);
        for (_, ticket) in &over {
            let has_begun = jobs.by_id.get(&ticket.job).is_some_and(|entry| entry.has_begun);
            let state = jobs.give_back(ticket.job, Release::Failed(lease_is_over()));
            jobs.statistics.attempts_failed += u64::from(has_begun);
            jobs.statistics.given_up += u64::from(state == State::Failed);
        }
        Ok(over.into_iter().map(|(_, ticket)| ticket).collect())
    }

    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        let mut jobs = self.jobs.lock();
        let entry = jobs.claimed(ticket)?;
        if let Some((events, progress)) = ending.rest {
            entry.job.progress = progress;
            entry.append(events);
        }
        jobs.end(ticket.job, ending.end);
        if !ending.result.is_empty() {
            jobs.keep(ticket.job, ending.result);
        }
        Ok(())
    }

    fn takes(&self, bytes: u64) -> bool {
        bytes <= SMALL_BLOBS && self.jobs.lock().blob_bytes + bytes <= BLOBS
    }

    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        let jobs = self.jobs.lock();
        let blob = jobs.by_id.get(&id).and_then(|entry| entry.blobs.iter().find(|blob| blob.name == name));
        Ok(blob.map(|blob| blob.bytes.clone()))
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        let jobs = &mut *self.jobs.lock();
        let Some(entry) = jobs.by_id.get_mut(&id) else {
            return Ok(None);
        };
        match entry.job.state {
            State::Queued => {
                entry.job.cancel_requested = true;
                jobs.end(id, End::Cancelled);
            }
            State::Running => {
                entry.job.cancel_requested = true;
                entry.append([]);
            }
            State::Succeeded | State::Failed | State::Cancelled => {}
        }
        Ok(jobs.by_id.get(&id).map(|entry| entry.job.clone()))
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        self.jobs.lock().arrivals.subscribe()
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        let jobs = self.jobs.lock();
        Ok(State::ALL.map(|state| jobs.by_id.values().filter(|entry| entry.job.state == state).count() as u64))
    }

    async fn waiting_of(&self, tenant: &str) -> Result<u64> {
        Ok(self.jobs.lock().queues.get(tenant).map_or(0, |queue| queue.waiting.len()) as u64)
    }

    async fn oldest_queued(&self) -> Result<Option<SystemTime>> {
        let jobs = self.jobs.lock();
        let waiting = jobs.by_id.values().filter(|entry| entry.job.state == State::Queued);
        Ok(waiting.map(|entry| entry.job.created_at).min())
    }
}

#[async_trait]
impl Events for MemoryStore {
    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        let mut jobs = self.jobs.lock();
        let entry = jobs.claimed(ticket)?;
        entry.job.progress = progress;
        entry.append(events);
        Ok(())
    }

    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        let jobs = self.jobs.lock();
        Ok(jobs.by_id.get(&id).map(|entry| {
            let first = usize::try_from(after).unwrap_or(usize::MAX).min(entry.events.len());
            let end = first.saturating_add(limit).min(entry.events.len());
            entry.events[first..end].to_vec()
        }))
    }

    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        let jobs = self.jobs.lock();
        Ok(jobs.by_id.get(&id).map(|entry| entry.pulse.subscribe()))
    }
}

#[async_trait]
impl Notices for MemoryStore {
    fn endings(&self) -> watch::Receiver<u64> {
        self.jobs.lock().endings.subscribe()
    }

    async fn untold(&self) -> Result<Vec<JobId>> {
        Ok(self.jobs.lock().untold.iter().map(|notice| notice.job).collect())
    }

    async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        Ok(self.jobs.lock().untold.iter().find(|notice| notice.job == id).cloned())
    }

    async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()> {
        self.jobs.lock().untold.retain(|notice| (notice.job, notice.ended_at) != (id, ended_at));
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

    async fn give_back(&self) -> Result<()> {
        Ok(())
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        let jobs = &mut *self.jobs.lock();
        match jobs.by_id.get(&id) {
            None => return Ok(Deletion::Unknown),
            Some(entry) if !entry.job.state.is_ended() => return Ok(Deletion::Live),
            Some(_) => {}
        }
        jobs.keep(id, Vec::new());
        if let Some(entry) = jobs.by_id.remove(&id) {
            jobs.numbers.remove(&entry.number);
            if let Some(ended_at) = entry.job.ended_at {
                jobs.ended.remove(&(ended_at, id));
            }
            if let Some(wanted) = entry.idempotency {
                jobs.keys.remove(&(entry.job.spec.tenant, wanted.key));
            }
        }
        Ok(Deletion::Deleted)
    }

    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        let jobs = self.jobs.lock();
        Ok(jobs.ended.iter().take_while(|(ended_at, _)| *ended_at < time).take(limit).map(|(_, id)| *id).collect())
    }

    async fn probe(&self) -> Result<()> {
        Ok(())
    }

    fn statistics(&self) -> Statistics {
        self.jobs.lock().statistics
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
