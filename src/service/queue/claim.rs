//! Claims: which jobs a worker gets, and what starts alone after a crash. The [queue](super) has the reasons.

use std::collections::{BTreeMap, HashMap};
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use super::job::{Rules, Standing};

/// What a store loads for a claim, in the transaction of the claim. One claim at a time sees the queue.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct View {
    /// The tenants with waiting jobs, in any order.
    pub tenants: Vec<Tenant>,
    /// The latest start of a turn of any tenant: the largest `served`, 0 when there is none.
    pub clock: f64,
    pub mine: Vec<Standing>,
    /// Whether no other worker comes before this one by (number of running jobs, id). Only workers count that run a
    /// job, and no suspect. True in a store of one worker.
    pub is_least_busy: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tenant {
    pub name: String,
    /// Its jobs that run, on any worker.
    pub running: u64,
    /// When its next turn starts, in virtual time: `next` of its last [`Turn`], 0 before the first one.
    pub next: f64,
    /// Its first waiting jobs that are no suspects, by urgency, then by number: as many as are claimed, if there are.
    pub waiting: Vec<Waiting>,
    /// Of its waiting suspects the one with the earliest `not_before`, then the smallest number.
    pub suspect: Option<Suspect>,
}

/// A waiting job. The order is that in which a tenant's jobs are claimed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Waiting {
    pub urgency: i16,
    pub number: i64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Suspect {
    pub number: i64,
    pub crashes: u32,
    pub not_before: SystemTime,
}

/// What the operator grants a tenant of the queue.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Share {
    /// A tenant of weight 2 gets twice as many running jobs as one of weight 1, the default.
    pub weight: Option<NonZeroU32>,
    /// Jobs that may run at a time; any number when none.
    pub max_running: Option<u64>,
}

/// The shares of all tenants; a tenant that is not in it has the default share.
pub(crate) type Shares = HashMap<String, Share>;

#[derive(Debug, Clone)]
pub(crate) struct Claiming {
    pub limit: usize,
    /// Most further jobs, only of tenants without a running job.
    pub newcomers: usize,
    pub lease: Duration,
    pub worker: Arc<str>,
    pub shares: Arc<Shares>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Picks {
    /// Numbers of the jobs, in the order of their claims. The store applies [`Change::Claim`](super::Change) to each.
    pub numbers: Vec<i64>,
    /// The last turn of each tenant that has one now. The store keeps it in the row of the tenant, which it may forget
    /// once `next` is not above the clock.
    pub turns: Vec<Turn>,
    /// When more may be claimed, if that needs time only.
    pub again: Option<SystemTime>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Turn {
    pub tenant: String,
    pub served: f64,
    pub next: f64,
}

/// The jobs that a worker gets now: a suspect alone, or others by [start-time fair queueing](Fair).
pub(crate) fn claim(view: View, claiming: &Claiming, rules: &Rules, now: SystemTime) -> Picks {
    let Claiming { limit, newcomers, shares, .. } = claiming;
    let mut fair = Fair { view, shares, turns: BTreeMap::new() };
    let mut numbers = Vec::new();
    let again = match fair.allowed(*limit, rules, now) {
        Allowed::Nothing(until) => Some(until),
        Allowed::Suspect(index) => {
            numbers.extend(fair.view.tenants[index].suspect.map(|suspect| suspect.number));
            fair.serve(index);
            None
        }
        Allowed::Others(again) => {
            while numbers.len() < limit + newcomers
                && let Some(index) = fair.next(numbers.len() >= *limit)
            {
                fair.serve(index);
                numbers.push(fair.view.tenants[index].waiting.remove(0).number);
            }
            again
        }
    };
    Picks { numbers, turns: fair.turns.into_values().collect(), again }
}

/// Start-time fair queueing over tenants (Goyal et al. 1996). A tenant has a virtual time, which each claimed job
/// advances by 1 / weight. A tenant that comes back after a pause starts at the clock: it neither waits for what it did
/// not use, nor gets credit for it.
struct Fair<'s> {
    view: View,
    shares: &'s Shares,
    /// By the index of the tenant.
    turns: BTreeMap<usize, Turn>,
}

impl Fair<'_> {
    fn share(&self, tenant: &Tenant) -> Share {
        self.shares.get(&tenant.name).copied().unwrap_or_default()
    }

    fn weight(&self, tenant: &Tenant) -> f64 {
        self.share(tenant).weight.map_or(1.0, |weight| weight.get().into())
    }

    fn is_below_limit(&self, tenant: &Tenant) -> bool {
        self.share(tenant).max_running.is_none_or(|most| tenant.running < most)
    }

    /// What suspects let the worker claim now; `limit` is 0 when it is full.
    fn allowed(&self, limit: usize, rules: &Rules, now: SystemTime) -> Allowed {
        let view = &self.view;
        // times that are further away than they can be come from a clock that was set back: they are over
        let is_alone = |job: &&Standing| job.suspicion > 0 && job.started_at.is_some_and(|start| start <= now);
        let until =
            view.mine.iter().filter(is_alone).filter_map(|job| Some(job.started_at? + alone(job.suspicion))).max();
        if let Some(until) = until.filter(|until| *until > now) {
            return Allowed::Nothing(until);
        }
        let waiting = view.tenants.iter().enumerate().filter(|(_, tenant)| self.is_below_limit(tenant));
        let waiting = waiting.filter_map(|(index, tenant)| {
            let suspect = tenant.suspect.as_ref()?;
            let is_in_reach = suspect.not_before <= now + rules.crash_pause;
            let start = if is_in_reach { suspect.not_before } else { SystemTime::UNIX_EPOCH };
            Some((start, suspect.number, suspect.crashes, index))
        });
        let Some((start, _, crashes, index)) = waiting.min() else { return Allowed::Others(None) };
        let latest = start + alone(crashes);
        if start > now {
            Allowed::Others(Some(start))
        } else if limit > 0 && (view.mine.is_empty() || latest <= now) {
            Allowed::Suspect(index)
        } else if latest > now && view.is_least_busy {
            Allowed::Nothing(latest)
        } else {
            Allowed::Others((latest > now).then_some(latest))
        }
    }

    fn next(&self, is_for_newcomer: bool) -> Option<usize> {
        let candidates = self.view.tenants.iter().enumerate().filter_map(|(index, tenant)| {
            let is_entitled = self.is_below_limit(tenant) && (!is_for_newcomer || tenant.running == 0);
            let job = tenant.waiting.first().filter(|_| is_entitled)?;
            let place = tenant.running as f64 / self.weight(tenant);
            Some((place, tenant.next.max(self.view.clock), job, index))
        });
        let first = candidates.min_by(|(place, start, job, _), (other_place, other_start, other_job, _)| {
            place.total_cmp(other_place).then(start.total_cmp(other_start)).then(job.cmp(other_job))
        });
        first.map(|(.., index)| index)
    }

    fn serve(&mut self, index: usize) {
        let weight = self.weight(&self.view.tenants[index]);
        let tenant = &mut self.view.tenants[index];
        self.view.clock = tenant.next.max(self.view.clock);
        tenant.running += 1;
        tenant.next = self.view.clock + 1.0 / weight;
        self.turns.insert(index, Turn { tenant: tenant.name.clone(), served: self.view.clock, next: tenant.next });
    }
}

/// For how long at most a worker that has other jobs waits for them before it starts a suspect of that many crashes;
/// and for how long after the start it claims nothing else. At most 22 days.
pub(super) fn alone(crashes: u32) -> Duration {
    Duration::from_secs(30 << crashes.saturating_sub(1).min(16))
}

/// What suspects let a worker claim.
#[derive(Debug, PartialEq)]
enum Allowed {
    /// Nothing until then, as a suspect runs alone, or is to.
    Nothing(SystemTime),
    /// Only the suspect of the tenant at this index.
    Suspect(usize),
    /// Jobs that are no suspects. The next suspect may start at that time, if one waits.
    Others(Option<SystemTime>),
}
