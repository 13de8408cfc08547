//! Which deliveries are due. Only bookkeeping: no I/O, and the time is passed in.
//!
//! Every host has its own share of the places, which is a single one until it has answered: fewer than [`AT_ONCE`]
//! hosts that do not answer delay no other one. After a delivery without any answer the host rests, with growing
//! pauses, however many jobs have a webhook there; then one delivery tries it again. An answer that is not a 2xx delays
//! the delivery itself only: other URLs of the host may work.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant, SystemTime};

use crate::store::JobId;

/// Deliveries at a time.
const AT_ONCE: usize = 256;

/// Deliveries at a time to one host that answered the last one; another gets one.
const PER_HOST: usize = 8;

/// Deliveries at a time to all hosts that do not answer.
const RESTING_AT_ONCE: usize = 8;

/// Pauses after the first failed attempts of a delivery, in seconds; the last one is repeated.
const PAUSES: [u64; 6] = [5, 30, 120, 600, 1800, 3600];

/// Pauses of a host after the first deliveries without any answer, in seconds; the last one is repeated.
const HOST_PAUSES: [u64; 4] = [5, 30, 120, 300];

/// Time after the end of a job after which its webhook is given up.
pub(super) const GIVEN_UP_AFTER: Duration = Duration::from_secs(24 * 3600);

/// How an attempt ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The receiver answered with a 2xx.
    Delivered,
    /// The receiver answered with something else.
    Refused,
    /// The receiver did not answer.
    Unanswered,
    /// Not to be tried again, or settled by another attempt.
    GivenUp,
}

impl Outcome {
    /// Whether no attempt follows.
    pub fn is_last(self) -> bool {
        matches!(self, Outcome::Delivered | Outcome::GivenUp)
    }
}

/// Deliveries that are not settled, and the hosts that they go to.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    deliveries: HashMap<JobId, Delivery>,
    hosts: HashMap<String, Host>,
}

#[derive(Debug)]
struct Delivery {
    host: String,
    ended_at: SystemTime,
    /// Attempts so far.
    made: usize,
    /// When the next attempt may begin.
    due: Instant,
    is_under_way: bool,
}

#[derive(Debug, Default)]
struct Host {
    under_way: usize,
    /// Deliveries without any answer since the last answer, those at the same time counted once.
    failures: usize,
    /// When the host may be tried again; none for a host that answers.
    rests_until: Option<Instant>,
    /// Whether it answered the last delivery.
    answers: bool,
}

/// What is to be done now.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Due {
    /// Deliveries to begin; they count as under way.
    pub begin: Vec<JobId>,
    /// Deliveries that are too old, and whose host does not answer, with the ends of their jobs.
    pub give_up: Vec<(JobId, SystemTime)>,
    /// When another delivery is due, unless a place becomes free before.
    pub next: Option<Instant>,
}

impl Schedule {
    /// Whether the delivery is known.
    pub fn knows(&self, job: JobId) -> bool {
        self.deliveries.contains_key(&job)
    }

    /// Adds a delivery that is due at `now`.
    pub fn add(&mut self, job: JobId, host: String, ended_at: SystemTime, now: Instant) {
        self.hosts.entry(host.clone()).or_default();
        self.deliveries.insert(job, Delivery { host, ended_at, made: 0, due: now, is_under_way: false });
    }

    /// Forgets settled deliveries, and hosts without any delivery. Those under way stay until they are
    /// [done](Self::done).
    pub fn keep_only(&mut self, untold: &[JobId]) {
        let untold: HashSet<JobId> = untold.iter().copied().collect();
        self.deliveries.retain(|job, delivery| delivery.is_under_way || untold.contains(job));
        let in_use: HashSet<&String> = self.deliveries.values().map(|delivery| &delivery.host).collect();
        self.hosts.retain(|host, _| in_use.contains(host));
    }

    /// Forgets a delivery that is settled and not under way.
    pub fn forget(&mut self, job: JobId) {
        self.deliveries.remove(&job);
    }

    /// Chooses the deliveries that begin now, in the order of `untold`: those to hosts that answer first.
    pub fn due(&mut self, untold: &[JobId], now: Instant, clock: SystemTime) -> Due {
        let mut due = Due::default();
        let mut places = AT_ONCE.saturating_sub(self.hosts.values().map(|host| host.under_way).sum());
        let resting = self.hosts.values().filter(|host| host.failures > 0).map(|host| host.under_way).sum();
        let mut resting_places = RESTING_AT_ONCE.saturating_sub(resting);
        let mut wake = |at: Instant| due.next = Some(due.next.map_or(at, |other: Instant| other.min(at)));
        for of_resting in [false, true] {
            for job in untold {
                let Some(delivery) = self.deliveries.get_mut(job).filter(|delivery| !delivery.is_under_way) else {
                    continue;
                };
                let Some(host) = self.hosts.get_mut(&delivery.host) else { continue };
                if of_resting != (host.failures > 0) {
                    continue;
                }
                if of_resting && clock.duration_since(delivery.ended_at).is_ok_and(|age| age > GIVEN_UP_AFTER) {
                    due.give_up.push((*job, delivery.ended_at));
                    continue;
                }
                let at = host.rests_until.map_or(delivery.due, |until| until.max(delivery.due));
                if at > now {
                    wake(at);
                    continue;
                }
                let has_place = match of_resting {
                    true => host.under_way == 0 && resting_places > 0,
                    false => host.under_way < if host.answers { PER_HOST } else { 1 },
                };
                if !has_place || places == 0 {
                    continue;
                }
                places -= 1;
                if of_resting {
                    resting_places -= 1;
                }
                host.under_way += 1;
                delivery.is_under_way = true;
                due.begin.push(*job);
            }
        }
        due
    }

    /// An attempt ended: notes it about the delivery and its host.
    pub fn done(&mut self, job: JobId, outcome: Outcome, now: Instant) {
        let Some(delivery) = self.deliveries.get_mut(&job) else { return };
        delivery.is_under_way = false;
        delivery.due = now + pause(&PAUSES, delivery.made);
        delivery.made += 1;
        let Some(host) = self.hosts.get_mut(&delivery.host) else { return };
        host.under_way = host.under_way.saturating_sub(1);
        match outcome {
            Outcome::Delivered | Outcome::Refused => {
                *host = Host { under_way: host.under_way, answers: true, ..Host::default() }
            }
            Outcome::Unanswered if host.rests_until.is_none_or(|until| until <= now) => {
                host.rests_until = Some(now + pause(&HOST_PAUSES, host.failures));
                host.failures += 1;
                host.answers = false;
            }
            Outcome::Unanswered | Outcome::GivenUp => {}
        }
    }

    /// Every delivery under way ended without an outcome: the task that carried it out panicked.
    pub fn reset(&mut self) {
        self.deliveries.clear();
        self.hosts.clear();
    }
}

fn pause(pauses: &[u64], made: usize) -> Duration {
    Duration::from_secs(pauses.get(made).or(pauses.last()).copied().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A schedule with a number of deliveries to each host, and all of them in order.
    fn schedule(hosts: &[(&str, usize)], now: Instant) -> (Schedule, Vec<JobId>) {
        let mut schedule = Schedule::default();
        let mut untold = Vec::new();
        for (host, jobs) in hosts {
            for _ in 0..*jobs {
                untold.push(JobId::random());
                schedule.add(untold[untold.len() - 1], (*host).to_owned(), SystemTime::now(), now);
            }
        }
        (schedule, untold)
    }

    #[test]
    fn a_host_that_does_not_answer_leaves_places_for_others() {
        let now = Instant::now();
        let (mut schedule, untold) = schedule(&[("dead", 1000), ("well", 1)], now);
        let first = schedule.due(&untold, now, SystemTime::now());
        assert_eq!(first.begin, [untold[0], untold[1000]], "a host has one place until it has answered");
        schedule.done(untold[0], Outcome::Delivered, now);
        let untold = &untold[1..];
        let second = schedule.due(untold, now, SystemTime::now());
        assert_eq!(second.begin.len(), PER_HOST);
        let after = now + Duration::from_secs(15);
        for job in &second.begin {
            schedule.done(*job, Outcome::Unanswered, after);
        }
        // eight at the same time are one failure of the host, which rests with all of its deliveries
        let rest = schedule.due(untold, after, SystemTime::now());
        assert_eq!((rest.begin, rest.next), (vec![], Some(after + Duration::from_secs(HOST_PAUSES[0]))));
        let later = after + Duration::from_secs(HOST_PAUSES[0]);
        let probe = schedule.due(untold, later, SystemTime::now());
        assert_eq!(probe.begin.len(), 1, "one delivery tries the host again");
        schedule.done(probe.begin[0], Outcome::Delivered, later);
        assert_eq!(schedule.due(untold, later, SystemTime::now()).begin.len(), PER_HOST, "it works again");
    }

    #[test]
    fn many_hosts_that_never_answered_leave_places_for_others() {
        let now = Instant::now();
        let names: Vec<String> = (0..100).map(|number| format!("dead-{number}")).collect();
        let hosts: Vec<(&str, usize)> = names.iter().map(|name| (name.as_str(), 5)).chain([("well", 1)]).collect();
        let (mut schedule, untold) = schedule(&hosts, now);
        let begun = schedule.due(&untold, now, SystemTime::now()).begin;
        assert_eq!((begun.len(), begun.last()), (hosts.len(), untold.last()));
    }

    #[test]
    fn hosts_that_do_not_answer_share_few_places() {
        let now = Instant::now();
        let names: Vec<String> = (0..3 * RESTING_AT_ONCE).map(|number| format!("dead-{number}")).collect();
        let hosts: Vec<(&str, usize)> = names.iter().map(|name| (name.as_str(), 1)).chain([("well", 99)]).collect();
        let (mut schedule, untold) = schedule(&hosts, now);
        for job in schedule.due(&untold, now, SystemTime::now()).begin {
            schedule.done(job, Outcome::Unanswered, now);
        }
        schedule.hosts.insert("well".to_owned(), Host { answers: true, ..Host::default() });
        let later = now + Duration::from_secs(3600);
        let begun = schedule.due(&untold, later, SystemTime::now()).begin;
        assert_eq!(begun.len(), PER_HOST + RESTING_AT_ONCE);
        let is_well = |job: &JobId| schedule.deliveries[job].host == "well";
        assert!(begun[..PER_HOST].iter().all(is_well), "hosts that answer come first");
    }

    #[test]
    fn a_refusal_delays_its_own_delivery_only() {
        let now = Instant::now();
        let (mut schedule, untold) = schedule(&[("host", 2)], now);
        assert_eq!(schedule.due(&untold, now, SystemTime::now()).begin, [untold[0]]);
        schedule.done(untold[0], Outcome::Refused, now);
        assert_eq!(schedule.due(&untold, now, SystemTime::now()).begin, [untold[1]]);
        schedule.done(untold[1], Outcome::GivenUp, now);
        let third = JobId::random();
        schedule.add(third, "host".to_owned(), SystemTime::now(), now);
        let untold = [untold[0], third];
        schedule.keep_only(&untold);
        let due = schedule.due(&untold, now, SystemTime::now());
        assert_eq!((due.begin, due.next), (vec![third], Some(now + Duration::from_secs(PAUSES[0]))));
    }

    #[test]
    fn old_deliveries_to_a_host_that_does_not_answer_are_given_up_without_an_attempt() {
        let now = Instant::now();
        let (mut schedule, untold) = schedule(&[("dead", 3)], now);
        let begun = schedule.due(&untold, now, SystemTime::now()).begin;
        for job in begun {
            schedule.done(job, Outcome::Unanswered, now);
        }
        let tomorrow = SystemTime::now() + GIVEN_UP_AFTER + Duration::from_secs(1);
        let given_up = schedule.due(&untold, now, tomorrow).give_up;
        assert_eq!(given_up.iter().map(|(job, _)| *job).collect::<Vec<_>>(), untold);
        schedule.keep_only(&[]);
        assert!(schedule.hosts.is_empty());
    }
}
