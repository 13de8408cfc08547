//! Random histories of a queue. [`play`] carries one out on anything that is [`Stored`], checks what must hold in each,
//! and writes down what it saw. A database follows the rules if it gives the same text as the [model](super::model).

use std::time::Duration;

use proptest::prelude::*;
use tesserae_mesh::error::{Error, Kind};

use super::super::{Change, JobEvent, Rules, State};

/// Pauses and [times alone](super::super::claim::alone) of a few crashes end within an [`HOUR`], and none within the
/// time that a database takes for a history.
pub const RULES: Rules = Rules { max_queued: 1000, max_attempts: 3, crash_pause: Duration::from_secs(1200) };

/// Seconds.
const HOUR: i64 = 3600;

/// Tenants of jobs: the second one of weight 3, the third one with a limit.
pub const TENANTS: [&str; 3] = ["a", "b", "c"];

/// What happens. Workers and jobs are taken modulo those that there are.
#[derive(Debug, Clone)]
pub enum Step {
    Create(New),
    /// A worker claims so many jobs, and so many of newcomers.
    Claim {
        worker: usize,
        limit: usize,
        newcomers: usize,
    },
    Act(usize, Act),
    /// A worker crashes.
    Crash(usize),
    /// The clock moves by so many seconds; it is set back by negative ones.
    Wait(i64),
}

/// A new job, which kills its worker that many seconds after it began, if it is a killer.
#[derive(Debug, Clone, Copy, Default)]
pub struct New {
    pub tenant: &'static str,
    pub priority: i8,
    pub is_small: bool,
    pub kills_after: Option<i64>,
}

/// What a worker or a client does to a job. A worker with a stale ticket changes nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Act {
    Begin,
    End,
    Fail,
    Free,
    LeaseOver,
    Stale,
    Cancel,
    Retry,
}

/// Histories of some twenty jobs.
pub fn histories() -> impl Strategy<Value = Vec<Step>> {
    use Act::*;
    let kills_after = prop_oneof![6 => Just(None), 1 => Just(Some(0)), 1 => Just(Some(100)), 1 => Just(Some(2 * HOUR))];
    let new = (prop::sample::select(&TENANTS[..]), -1..2i8, any::<bool>(), kills_after);
    let create = new.prop_map(|(tenant, priority, is_small, kills_after)| {
        Step::Create(New { tenant, priority, is_small, kills_after })
    });
    let claim = (0..9usize, 0..4usize, 0..2usize);
    let claim = claim.prop_map(|(worker, limit, newcomers)| Step::Claim { worker, limit, newcomers });
    let acts = [Begin, Begin, Begin, Begin, End, End, Fail, Fail, Free, LeaseOver, Stale, Cancel, Retry, Retry];
    let act = (any::<usize>(), prop::sample::select(acts.to_vec())).prop_map(|(job, act)| Step::Act(job, act));
    let crash = (0..9usize).prop_map(Step::Crash);
    let wait = prop::sample::select(vec![HOUR, HOUR, HOUR, -2 * HOUR]).prop_map(Step::Wait);
    prop::collection::vec(prop_oneof![4 => create, 6 => claim, 12 => act, 1 => crash, 3 => wait], 1..80)
}

/// A store. Jobs are numbered by their creation, from 0.
pub trait Stored {
    fn workers(&self) -> usize;
    async fn create(&mut self, new: New);
    /// Jobs with their attempts, in order.
    async fn claim(&mut self, worker: usize, limit: usize, newcomers: usize) -> Vec<(usize, u32)>;
    /// Any change but claims and crashes; false if it is refused.
    async fn change(&mut self, job: usize, change: Change) -> bool;
    async fn crash(&mut self, worker: usize);
    async fn wait(&mut self, seconds: i64);
    /// Changes of the state of a job, numbered without gaps.
    async fn events(&mut self, job: usize) -> Vec<JobEvent>;
}

/// A job as its client and its worker know it.
#[derive(Clone, Copy, Default)]
struct Job {
    new: New,
    state: State,
    /// Attempts that failed since the last retry.
    faults: u32,
    is_cancelled: bool,
    worker: usize,
    attempt: u32,
    /// When the attempt began, by [`Play::elapsed`].
    begun: Option<i64>,
}

struct Play<'s, S> {
    stored: &'s mut S,
    jobs: Vec<Job>,
    /// Seconds that passed, whatever the clock says.
    elapsed: i64,
    seen: Vec<String>,
}

/// Carries out the steps, and then lets all jobs end if `ends`; what was seen.
pub async fn play<S: Stored>(history: &[Step], stored: &mut S, ends: bool) -> Vec<String> {
    let mut play = Play { stored, jobs: Vec::new(), elapsed: 0, seen: Vec::new() };
    for step in history {
        play.step(step).await;
    }
    if ends {
        play.settle().await;
    }
    for job in 0..play.jobs.len() {
        let events = play.stored.events(job).await;
        play.seen.push(format!("{job}: {events:?}"));
    }
    play.seen
}

impl<S: Stored> Play<'_, S> {
    async fn step(&mut self, step: &Step) {
        match *step {
            Step::Create(new) => {
                self.stored.create(new).await;
                self.jobs.push(Job { new, ..Job::default() });
            }
            Step::Claim { worker, limit, newcomers } => self.claim(worker, limit, newcomers).await,
            Step::Act(job, act) => self.act(job, act).await,
            Step::Crash(worker) => self.crash(worker % self.stored.workers()).await,
            Step::Wait(seconds) => {
                self.stored.wait(seconds).await;
                self.elapsed += seconds.max(0);
            }
        }
        while let Some(worker) = self.killed() {
            self.crash(worker).await;
        }
    }

    fn running(&self) -> impl Iterator<Item = (usize, &Job)> {
        self.jobs.iter().enumerate().filter(|(_, job)| job.state == State::Running)
    }

    /// The worker of a killer whose time has come.
    fn killed(&self) -> Option<usize> {
        let kills = |job: &Job| Some(self.elapsed >= job.begun? + job.new.kills_after?);
        self.running().find(|(_, job)| kills(job).unwrap_or(false)).map(|(_, job)| job.worker)
    }

    /// Looks at the state of the job.
    async fn look(&mut self, job: usize) -> State {
        self.jobs[job].state = state(&self.stored.events(job).await);
        self.jobs[job].state
    }

    async fn claim(&mut self, worker: usize, limit: usize, newcomers: usize) {
        let worker = worker % self.stored.workers();
        let claimed = self.stored.claim(worker, limit, newcomers).await;
        self.seen.push(format!("{worker} claims {claimed:?}"));
        assert!(claimed.len() <= limit + newcomers, "{claimed:?}");
        for (job, attempt) in claimed {
            assert_eq!(self.jobs[job].state, State::Queued, "{job} is claimed twice");
            assert_eq!(self.look(job).await, State::Running);
            let begun = self.jobs[job].new.is_small.then_some(self.elapsed);
            self.jobs[job] = Job { worker, attempt, begun, ..self.jobs[job] };
        }
        assert!(self.running().filter(|(_, job)| job.new.tenant == TENANTS[2]).count() <= 1, "the limit of the tenant");
    }

    async fn act(&mut self, job: usize, act: Act) {
        let Some(job) = job.checked_rem(self.jobs.len()) else { return };
        let Job { attempt, state, begun, .. } = self.jobs[job];
        let end = |attempt| Change::End { attempt, state: State::Succeeded, problem: None };
        let failure = Error::new(Kind::DeviceLost, "the card fell out");
        let is_running = state == State::Running;
        // with what comes of it if it is allowed: whether the job was given back by a fault
        let (change, is_allowed, is_fault) = match act {
            Act::Begin => (Change::Begin(attempt), is_running, None),
            Act::End => (end(attempt), is_running, None),
            Act::Stale => (end(attempt.wrapping_sub(1)), false, None),
            Act::Fail => (Change::Release { attempt, fault: Some(failure) }, is_running, Some(begun.is_some())),
            Act::Free => (Change::Release { attempt, fault: None }, is_running, Some(false)),
            Act::LeaseOver => (Change::LeaseOver, is_running, Some(begun.is_some())),
            Act::Cancel => (Change::Cancel, true, None),
            Act::Retry => (Change::Retry, state == State::Failed, None),
        };
        assert_eq!(self.stored.change(job, change).await, is_allowed, "{act:?} of {job}, {state:?}");
        self.seen.push(format!("{act:?} of {job} {is_allowed}"));
        let known = &mut self.jobs[job];
        match act {
            Act::Begin if is_allowed => known.begun = begun.or(Some(self.elapsed)),
            Act::Cancel => known.is_cancelled |= !state.is_ended(),
            Act::Retry if is_allowed => known.faults = 0,
            _ => {}
        }
        if let Some(is_fault) = is_fault.filter(|_| is_allowed) {
            self.gave_back(job, is_fault).await;
        }
        self.look(job).await;
    }

    /// A crash counts for a job only if no other one can have caused it.
    async fn crash(&mut self, worker: usize) {
        let lost: Vec<_> = self.running().filter(|(_, job)| job.worker == worker).map(|(index, _)| index).collect();
        let has_begun = |job: &&usize| self.jobs[**job].begun.is_some();
        let begun = lost.iter().filter(has_begun).count();
        self.stored.crash(worker).await;
        self.seen.push(format!("{worker} crashes"));
        for job in lost {
            self.gave_back(job, begun == 1 && self.jobs[job].begun.is_some()).await;
        }
    }

    /// A job is given up after as many faults as may be, and never before.
    async fn gave_back(&mut self, job: usize, is_fault: bool) {
        let known = &mut self.jobs[job];
        known.faults += u32::from(is_fault);
        let expected = match known {
            Job { is_cancelled: true, .. } => State::Cancelled,
            Job { faults, .. } if is_fault && *faults >= RULES.max_attempts => State::Failed,
            _ => State::Queued,
        };
        assert_eq!(self.look(job).await, expected, "{job} after {} faults", self.jobs[job].faults);
    }

    /// Workers claim until every job has ended. Jobs that kill nothing take one round.
    async fn settle(&mut self) {
        for round in 0..2000 {
            self.step(&Step::Wait(if round < 100 { 30 } else { 600 })).await;
            for job in 0..self.jobs.len() {
                if self.jobs[job].new.kills_after.is_none() {
                    self.act(job, Act::End).await;
                }
            }
            for worker in 0..self.stored.workers() {
                let running = self.running().filter(|(_, job)| job.worker == worker).count();
                self.step(&Step::Claim { worker, limit: 2usize.saturating_sub(running), newcomers: 1 }).await;
            }
            for job in 0..self.jobs.len() {
                self.step(&Step::Act(job, Act::Begin)).await;
            }
            if self.jobs.iter().all(|job| job.state.is_ended()) {
                return;
            }
        }
        panic!("a job is passed over");
    }
}

/// The state that the events of a job give.
pub fn state(events: &[JobEvent]) -> State {
    let (mut state, mut attempts) = (None, 0);
    for event in events {
        state = Some(match (state, event) {
            (None | Some(State::Running | State::Failed), JobEvent::Queued) => State::Queued,
            (Some(State::Queued), JobEvent::Started(attempt, _)) if *attempt == attempts + 1 => {
                attempts += 1;
                State::Running
            }
            (Some(State::Running), JobEvent::End(end, _)) => *end,
            (Some(State::Queued), JobEvent::End(State::Cancelled, None)) => State::Cancelled,
            _ => panic!("{event:?} follows {state:?}: {events:?}"),
        });
    }
    state.expect("a job has events")
}
