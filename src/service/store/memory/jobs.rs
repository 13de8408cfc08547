//! The state of the store in memory, and every change of a job's state.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::SystemTime;

use tokio::sync::watch;

use super::super::fairness::{VirtualTimes, Waiting, first_tenants};
use super::super::pulses::Signal;
use super::super::{
    Claiming, End, Event, Idempotency, Job, JobId, Notice, Pulse, Release, Rules, SmallBlob, State, Statistics, Ticket,
    What, given_up, no_such_job, not_yours,
};
use crate::error::{Kind, Result};

/// All jobs.
#[derive(Debug)]
pub(super) struct Jobs {
    pub rules: Rules,
    pub by_id: HashMap<JobId, Entry>,
    /// Jobs by their number, which counts the jobs ever created.
    pub numbers: BTreeMap<u64, JobId>,
    /// The queue of each tenant that has ever had a job.
    pub queues: BTreeMap<String, TenantQueue>,
    pub virtual_times: VirtualTimes,
    /// Ended jobs by the time of their end.
    pub ended: BTreeSet<(SystemTime, JobId)>,
    /// Jobs by tenant and key.
    pub keys: HashMap<(String, String), JobId>,
    pub created: u64,
    /// Ends whose webhook was not settled, in their order.
    pub untold: Vec<Notice>,
    /// Bytes of all small blobs.
    pub blob_bytes: u64,
    /// Whether the last claim passed over a waiting job that another job's end may free.
    pub has_held_back: bool,
    pub statistics: Statistics,
    pub arrivals: Signal,
    pub endings: Signal,
}

/// The live jobs of a tenant.
#[derive(Debug, Default)]
pub(super) struct TenantQueue {
    /// Priority, negated, and number of those that wait: the first is claimed first.
    pub waiting: BTreeSet<(i16, u64)>,
    pub running: u64,
}

/// A job, and what only the store knows of it.
#[derive(Debug)]
pub(super) struct Entry {
    pub number: u64,
    pub job: Job,
    /// Attempts that do not count.
    pub uncounted: u32,
    /// Whether the current attempt counts.
    pub has_begun: bool,
    pub lease_until: SystemTime,
    pub idempotency: Option<Idempotency>,
    pub blobs: Vec<SmallBlob>,
    pub events: Vec<Event>,
    pub pulse: watch::Sender<Pulse>,
}

impl Jobs {
    pub fn new(rules: Rules) -> Self {
        Self {
            rules,
            by_id: HashMap::new(),
            numbers: BTreeMap::new(),
            queues: BTreeMap::new(),
            virtual_times: VirtualTimes::default(),
            ended: BTreeSet::new(),
            keys: HashMap::new(),
            created: 0,
            untold: Vec::new(),
            blob_bytes: 0,
            has_held_back: false,
            statistics: Statistics::default(),
            arrivals: Signal::default(),
            endings: Signal::default(),
        }
    }

    /// The job with its place in the queue.
    pub fn with_place(&self, entry: &Entry) -> Job {
        let mut job = entry.job.clone();
        let queue = self.queues.get(&job.spec.tenant).filter(|_| job.state == State::Queued);
        job.queue_position = queue.map(|queue| queue.waiting.range(..=entry.place()).count() as u64);
        job
    }

    /// Number of jobs that wait.
    pub fn waiting(&self) -> u64 {
        self.queues.values().map(|queue| queue.waiting.len() as u64).sum()
    }

    /// The waiting job that is claimed next, if any may be.
    pub fn next(&self, claiming: &Claiming, newcomers: bool) -> Option<JobId> {
        let queues = self.queues.iter().filter(|(_, queue)| !queue.waiting.is_empty());
        let waiting: Vec<_> =
            queues.map(|(tenant, queue)| Waiting { tenant: tenant.clone(), running: queue.running }).collect();
        let first = first_tenants(&waiting, &self.virtual_times, &claiming.shares, newcomers);
        let heads = first.iter().filter_map(|&index| self.queues[&waiting[index].tenant].waiting.first());
        self.numbers.get(&heads.min()?.1).copied()
    }

    /// The running job that a ticket is valid for.
    pub fn claimed(&mut self, ticket: Ticket) -> Result<&mut Entry> {
        let entry = self.by_id.get_mut(&ticket.job).ok_or_else(|| no_such_job(ticket.job))?;
        if entry.is_held_by(ticket) { Ok(entry) } else { Err(not_yours(ticket.job)) }
    }

    /// Replaces the small blobs of a job.
    pub fn keep(&mut self, id: JobId, blobs: Vec<SmallBlob>) {
        let bytes = |blobs: &[SmallBlob]| blobs.iter().map(|blob| blob.bytes.len() as u64).sum::<u64>();
        if let Some(entry) = self.by_id.get_mut(&id) {
            self.blob_bytes = self.blob_bytes + bytes(&blobs) - bytes(&entry.blobs);
            entry.blobs = blobs;
        }
    }

    /// Puts a job that does not wait into the queue.
    pub fn queue(&mut self, id: JobId) {
        self.leave_queue(id);
        let Some(entry) = self.by_id.get_mut(&id) else { return };
        entry.job.state = State::Queued;
        entry.append([What::State(State::Queued)]);
        let place = entry.place();
        self.queues.entry(entry.job.spec.tenant.clone()).or_default().waiting.insert(place);
        self.arrivals.notify();
    }

    /// Takes a live job out of its tenant's queue, before its state changes.
    pub fn leave_queue(&mut self, id: JobId) {
        let Some(entry) = self.by_id.get(&id) else { return };
        let Some(queue) = self.queues.get_mut(&entry.job.spec.tenant) else { return };
        match entry.job.state {
            State::Queued => {
                queue.waiting.remove(&entry.place());
            }
            State::Running => queue.running -= 1,
            State::Succeeded | State::Failed | State::Cancelled => {}
        }
    }

    /// Gives a running job back.
    pub fn give_back(&mut self, id: JobId, release: Release) -> State {
        let Some(entry) = self.by_id.get_mut(&id) else { return State::Cancelled };
        let counted = entry.job.attempt.saturating_sub(entry.uncounted);
        match release {
            _ if entry.job.cancel_requested => return self.end(id, End::Cancelled),
            Release::Failed(error) if entry.has_begun && counted >= self.rules.max_attempts => {
                return self.end(id, End::Failed(given_up(counted.into(), &error)));
            }
            Release::Failed(_) if entry.has_begun => {}
            Release::Failed(_) | Release::Free => entry.uncounted += 1,
        }
        self.queue(id);
        State::Queued
    }

    /// Ends a job; its state after that.
    pub fn end(&mut self, id: JobId, end: End) -> State {
        self.leave_queue(id);
        let (state, problem, summary) = end.parts();
        if problem.is_none_or(|problem| problem.kind != Kind::Poison) {
            self.keep(id, Vec::new());
        }
        if self.has_held_back {
            self.arrivals.notify();
        }
        let Some(entry) = self.by_id.get_mut(&id) else { return state };
        let ended_at = SystemTime::now();
        entry.job.state = state;
        entry.job.problem = problem.cloned();
        entry.job.summary = summary.cloned();
        entry.job.ended_at = Some(ended_at);
        entry.append([What::End(state, problem.cloned())]);
        self.ended.insert((ended_at, id));
        if let Some(webhook) = entry.job.spec.webhook.clone() {
            self.untold.retain(|notice| notice.job != id);
            self.untold.push(Notice {
                job: id,
                webhook,
                trace_parent: entry.job.spec.trace_parent.clone(),
                state,
                problem: problem.cloned(),
                ended_at,
                end: entry.events.iter().filter(|event| matches!(event.what, What::End(..))).count() as u32,
            });
            self.endings.notify();
        }
        state
    }
}

impl Entry {
    /// Its place among the waiting jobs of its tenant.
    pub fn place(&self) -> (i16, u64) {
        (-i16::from(self.job.spec.priority), self.number)
    }

    pub fn is_held_by(&self, ticket: Ticket) -> bool {
        self.job.state == State::Running && self.job.attempt == ticket.attempt
    }

    /// Appends events and wakes their readers.
    pub fn append(&mut self, events: impl IntoIterator<Item = What>) {
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
