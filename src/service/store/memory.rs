//! Jobs in memory: for one process, until it ends.
//!
//! One lock around everything, held for look-ups only and never across an await.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use async_trait::async_trait;
use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use tokio::sync::watch;

use super::{
    Deletion, End, Event, Job, JobId, JobStore, ListQuery, Page, Progress, Pulse, Spec, State, Ticket, What,
    no_such_job,
};
use crate::error::{Error, Kind, Result};

/// A store that forgets everything when the process ends.
#[derive(Debug)]
pub(in crate::service) struct MemoryStore {
    max_queued: usize,
    inner: Mutex<Inner>,
    arrivals: watch::Sender<u64>,
    endings: watch::Sender<u64>,
}

#[derive(Debug, Default)]
struct Inner {
    jobs: HashMap<JobId, Entry>,
    /// Jobs by their number, which counts the jobs ever created.
    numbers: BTreeMap<u64, JobId>,
    /// Numbers of the jobs that wait, ascending.
    queue: VecDeque<u64>,
    created: u64,
    /// Ended jobs whose webhook was not settled, in the order of their ends.
    untold: Vec<JobId>,
}

#[derive(Debug)]
struct Entry {
    number: u64,
    job: Job,
    attempt: u32,
    events: Vec<Event>,
    pulse: watch::Sender<Pulse>,
}

impl MemoryStore {
    /// An empty store in which at most `max_queued` jobs wait.
    pub fn new(max_queued: usize) -> Self {
        Self {
            max_queued,
            inner: Mutex::default(),
            arrivals: watch::Sender::default(),
            endings: watch::Sender::default(),
        }
    }

    /// The state; it is whole at every moment in which a holder of the lock could panic.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A job just ended: notes it if someone wants to be told.
    fn ended(&self, untold: &mut Vec<JobId>, job: &Job) {
        if job.spec.webhook.is_some() {
            untold.push(job.id);
            self.endings.send_modify(|count| *count += 1);
        }
    }

    /// Whether one more job may wait.
    fn room(&self, inner: &Inner) -> Result<()> {
        if inner.queue.len() >= self.max_queued {
            return Err(Error::new(
                Kind::QueueFull,
                format_args!("as many jobs wait as may; try again later: {}", self.max_queued),
            ));
        }
        Ok(())
    }
}

impl Inner {
    /// The job as it is told to others, with its place in the queue.
    fn tell(&self, entry: &Entry) -> Job {
        let mut job = entry.job.clone();
        job.queue_position = (job.state == State::Queued)
            .then(|| self.queue.binary_search(&entry.number).ok())
            .flatten()
            .map(|before| before as u64 + 1);
        job
    }

    /// The running job that a ticket is valid for.
    fn claimed(&mut self, ticket: Ticket) -> Result<&mut Entry> {
        let entry = self.jobs.get_mut(&ticket.job).ok_or_else(|| no_such_job(ticket.job))?;
        if entry.job.state != State::Running || entry.attempt != ticket.attempt {
            return Err(Error::new(Kind::Conflict, format_args!("the job is no longer this worker's: {}", ticket.job)));
        }
        Ok(entry)
    }
}

impl Entry {
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

    /// Ends the job.
    fn end(&mut self, end: End) {
        self.job.ended_at = Some(SystemTime::now());
        match end {
            End::Succeeded(summary) => {
                self.job.state = State::Succeeded;
                self.job.summary = Some(summary);
            }
            End::Failed(error) => {
                self.job.state = State::Failed;
                self.job.problem = Some(error);
            }
            End::Cancelled => self.job.state = State::Cancelled,
        }
        self.append([What::End(self.job.state, self.job.problem.clone())]);
    }
}

#[async_trait]
impl JobStore for MemoryStore {
    async fn check_room(&self) -> Result<()> {
        self.room(&self.lock())
    }

    async fn create(&self, id: JobId, spec: Spec) -> Result<Job> {
        let mut inner = self.lock();
        self.room(&inner)?;
        inner.created += 1;
        let number = inner.created;
        let mut entry = Entry {
            number,
            job: Job {
                id,
                state: State::Queued,
                spec,
                queue_position: None,
                progress: Progress::default(),
                cancel_requested: false,
                problem: None,
                summary: None,
                created_at: SystemTime::now(),
                started_at: None,
                ended_at: None,
            },
            attempt: 0,
            events: Vec::new(),
            pulse: watch::Sender::default(),
        };
        entry.append([What::State(State::Queued)]);
        inner.queue.push_back(number);
        inner.numbers.insert(number, id);
        let job = inner.tell(&entry);
        inner.jobs.insert(id, entry);
        self.arrivals.send_replace(number);
        Ok(job)
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        let inner = self.lock();
        Ok(inner.jobs.get(&id).map(|entry| inner.tell(entry)))
    }

    async fn list(&self, query: &ListQuery) -> Result<Page> {
        let before = match &query.cursor {
            Some(cursor) => number_of(cursor)?,
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
        page.next = entries.next().map(|_| cursor_of(last));
        Ok(page)
    }

    async fn claim(&self) -> Result<Option<(Ticket, Job)>> {
        let mut inner = self.lock();
        let Some(number) = inner.queue.pop_front() else {
            return Ok(None);
        };
        let inner = &mut *inner;
        let entry = inner.numbers.get(&number).and_then(|id| inner.jobs.get_mut(id));
        Ok(entry.map(|entry| {
            entry.attempt += 1;
            entry.job.state = State::Running;
            entry.job.started_at = Some(SystemTime::now());
            entry.append([What::State(State::Running)]);
            let ticket = Ticket { job: entry.job.id, attempt: entry.attempt };
            (ticket, entry.job.clone())
        }))
    }

    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        let mut inner = self.lock();
        let entry = inner.claimed(ticket)?;
        entry.job.progress = progress;
        entry.append(events);
        Ok(())
    }

    async fn finish(&self, ticket: Ticket, end: End) -> Result<()> {
        let mut inner = self.lock();
        let entry = inner.claimed(ticket)?;
        entry.end(end);
        let job = entry.job.clone();
        self.ended(&mut inner.untold, &job);
        Ok(())
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
                if let Ok(place) = inner.queue.binary_search(&entry.number) {
                    inner.queue.remove(place);
                }
                entry.end(End::Cancelled);
                self.ended(&mut inner.untold, &entry.job);
            }
            State::Running => {
                entry.job.cancel_requested = true;
                entry.append([]);
            }
            State::Succeeded | State::Failed | State::Cancelled => {}
        }
        Ok(Some(entry.job.clone()))
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        let mut inner = self.lock();
        match inner.jobs.get(&id) {
            None => Ok(Deletion::Unknown),
            Some(entry) if !entry.job.state.is_ended() => Ok(Deletion::Live),
            Some(entry) => {
                let number = entry.number;
                inner.numbers.remove(&number);
                inner.jobs.remove(&id);
                inner.untold.retain(|other| *other != id);
                Ok(Deletion::Deleted)
            }
        }
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

    fn arrivals(&self) -> watch::Receiver<u64> {
        let mut receiver = self.arrivals.subscribe();
        receiver.mark_changed();
        receiver
    }

    fn endings(&self) -> watch::Receiver<u64> {
        let mut receiver = self.endings.subscribe();
        receiver.mark_changed();
        receiver
    }

    async fn untold(&self) -> Result<Vec<JobId>> {
        Ok(self.lock().untold.clone())
    }

    async fn settle_webhook(&self, id: JobId) -> Result<()> {
        self.lock().untold.retain(|other| *other != id);
        Ok(())
    }

    async fn queued_of(&self, tenant: &str) -> Result<u64> {
        let inner = self.lock();
        let waiting = inner.queue.iter().filter_map(|number| inner.jobs.get(inner.numbers.get(number)?));
        Ok(waiting.filter(|entry| entry.job.spec.tenant == tenant).count() as u64)
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        let inner = self.lock();
        Ok(State::ALL.map(|state| inner.jobs.values().filter(|entry| entry.job.state == state).count() as u64))
    }
}

/// The cursor of the page after the job of that number.
fn cursor_of(number: u64) -> String {
    URL_SAFE_NO_PAD.encode(format!("before {number}"))
}

/// The number in a cursor.
fn number_of(cursor: &str) -> Result<u64> {
    URL_SAFE_NO_PAD
        .decode(cursor)
        .ok()
        .and_then(|bytes| std::str::from_utf8(&bytes).ok()?.strip_prefix("before ")?.parse().ok())
        .ok_or_else(|| Error::parameter(format_args!("cursor is not one that a list of jobs gave: {cursor:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::store::conformance;

    #[tokio::test]
    async fn conforms() {
        conformance::run(&|max_queued| Box::new(MemoryStore::new(max_queued))).await;
    }
}
