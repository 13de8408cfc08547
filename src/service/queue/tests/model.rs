//! The smallest store that follows the rules.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use super::super::{
    Change, Claiming, JobEvent, Picks, Share, Shares, Standing, State, Suspect, Tenant, View, Waiting, claim, crashed,
};
use super::history::{New, RULES, Stored, TENANTS};

/// What a worker may claim: no lease ends by itself.
pub fn claiming(worker: usize, limit: usize, newcomers: usize, weight: u32) -> Claiming {
    let b = Share { weight: NonZeroU32::new(weight), max_running: None };
    let c = Share { weight: None, max_running: Some(1) };
    let shares = Arc::new(Shares::from([("b".to_owned(), b), ("c".to_owned(), c)]));
    Claiming { limit, newcomers, lease: Duration::from_secs(1 << 30), worker: worker.to_string().into(), shares }
}

/// Rules that are wrong, to see comparisons and checks fail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Altered {
    Nothing,
    /// A crash makes no suspects.
    Suspects,
    /// A crash counts for all jobs that had begun.
    Blame,
}

struct Row {
    new: New,
    waiting: Waiting,
    standing: Standing,
    worker: usize,
    events: Vec<JobEvent>,
}

/// A store in memory.
pub struct Model {
    workers: usize,
    altered: Altered,
    now: SystemTime,
    rows: Vec<Row>,
    /// Of each tenant `served` and `next`.
    turns: BTreeMap<String, (f64, f64)>,
}

impl Model {
    pub fn new(workers: usize, altered: Altered) -> Self {
        Self { workers, altered, now: super::now(), rows: Vec::new(), turns: BTreeMap::new() }
    }

    fn running(&self, worker: usize) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.standing.state == State::Running && row.worker == worker)
    }

    fn view(&self, worker: usize) -> View {
        let load = |worker| (self.running(worker).count(), worker);
        let counts = |other: &usize| {
            self.running(*other).count() > 0 && self.running(*other).all(|row| row.standing.suspicion == 0)
        };
        let tenants = TENANTS.map(|name| {
            let rows = self.rows.iter().filter(|row| row.new.tenant == name);
            let queued = rows.clone().filter(|row| row.standing.state == State::Queued);
            let is_suspect = |row: &&Row| row.standing.suspicion > 0;
            let mut waiting: Vec<_> = queued.clone().filter(|row| !is_suspect(row)).map(|row| row.waiting).collect();
            waiting.sort();
            let suspects = queued.filter(is_suspect).filter_map(|row| {
                let Standing { suspicion, not_before, .. } = row.standing;
                Some(Suspect { number: row.waiting.number, crashes: suspicion, not_before: not_before? })
            });
            let suspect = suspects.min_by_key(|suspect| (suspect.not_before, suspect.number));
            let running = rows.filter(|row| row.standing.state == State::Running).count() as u64;
            let next = self.turns.get(name).map_or(0.0, |(_, next)| *next);
            Tenant { name: name.to_owned(), running, next, waiting, suspect }
        });
        View {
            tenants: tenants.into(),
            clock: self.turns.values().map(|(served, _)| *served).fold(0.0, f64::max),
            mine: self.running(worker).map(|row| row.standing).collect(),
            is_least_busy: (0..self.workers).filter(counts).all(|other| load(worker) <= load(other)),
        }
    }
}

impl Stored for Model {
    fn workers(&self) -> usize {
        self.workers
    }

    async fn create(&mut self, new: New) {
        let standing = Standing { is_small: new.is_small, ..Standing::default() };
        let waiting = Waiting { urgency: -i16::from(new.priority), number: self.rows.len() as i64 };
        self.rows.push(Row { new, waiting, standing, worker: 0, events: vec![JobEvent::Queued] });
    }

    async fn claim(&mut self, worker: usize, limit: usize, newcomers: usize) -> Vec<(usize, u32)> {
        let claiming = claiming(worker, limit, newcomers, 3);
        let Picks { numbers, turns, .. } = claim(self.view(worker), &claiming, &RULES, self.now);
        self.turns.extend(turns.into_iter().map(|turn| (turn.tenant, (turn.served, turn.next))));
        let mut claimed = Vec::new();
        for number in numbers {
            let job = number as usize;
            let change = Change::Claim(claiming.worker.clone(), claiming.lease);
            assert!(self.change(job, change).await, "{job} waits");
            self.rows[job].worker = worker;
            claimed.push((job, self.rows[job].standing.attempt));
        }
        claimed
    }

    async fn change(&mut self, job: usize, change: Change) -> bool {
        // no two changes have one time
        self.now += Duration::from_millis(1);
        let row = &mut self.rows[job];
        let Ok((standing, event)) = row.standing.apply(change, &RULES, self.now) else { return false };
        let suspicion = if self.altered == Altered::Suspects { 0 } else { standing.suspicion };
        row.standing = Standing { suspicion, ..standing };
        row.events.extend(event);
        true
    }

    async fn crash(&mut self, worker: usize) {
        let numbers: Vec<_> = self.running(worker).map(|row| row.waiting.number as usize).collect();
        let standings: Vec<_> = numbers.iter().map(|job| self.rows[*job].standing).collect();
        for (job, mut change) in numbers.into_iter().zip(crashed(&standings)) {
            if self.altered == Altered::Blame {
                change = Change::Crashed { counts: true };
            }
            assert!(self.change(job, change).await, "{job} runs");
        }
    }

    async fn wait(&mut self, seconds: i64) {
        let moved = Duration::from_secs(seconds.unsigned_abs());
        self.now = if seconds < 0 { self.now - moved } else { self.now + moved };
    }

    async fn events(&mut self, job: usize) -> Vec<JobEvent> {
        self.rows[job].events.clone()
    }
}
