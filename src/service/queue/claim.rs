//! Claims: which jobs a worker gets.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use super::crash::{Allowed, allowed};
use super::rules::Rules;
use super::view::{Tenant, View};

/// What the operator grants a tenant of the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Share {
    /// At least 1: a tenant of weight 2 gets twice as many running jobs as one of weight 1.
    pub weight: u32,
    /// Jobs that may run at a time; any number when none.
    pub max_running: Option<u64>,
}

impl Default for Share {
    fn default() -> Self {
        Self { weight: 1, max_running: None }
    }
}

impl Share {
    fn weight(self) -> f64 {
        f64::from(self.weight.max(1))
    }
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
    let again = match allowed(&fair.view, *limit, |tenant| fair.is_below_limit(tenant), rules, now) {
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

    fn is_below_limit(&self, tenant: &Tenant) -> bool {
        self.share(tenant).max_running.is_none_or(|most| tenant.running < most)
    }

    /// The tenant that is next.
    fn next(&self, is_for_newcomer: bool) -> Option<usize> {
        let candidates = self.view.tenants.iter().enumerate().filter_map(|(index, tenant)| {
            let is_entitled = self.is_below_limit(tenant) && (!is_for_newcomer || tenant.running == 0);
            let job = tenant.waiting.first().filter(|_| is_entitled)?;
            let place = tenant.running as f64 / self.share(tenant).weight();
            Some((place, tenant.next.max(self.view.clock), job, index))
        });
        let first = candidates.min_by(|(place, start, job, _), (other_place, other_start, other_job, _)| {
            place.total_cmp(other_place).then(start.total_cmp(other_start)).then(job.cmp(other_job))
        });
        first.map(|(.., index)| index)
    }

    fn serve(&mut self, index: usize) {
        let weight = self.share(&self.view.tenants[index]).weight();
        let tenant = &mut self.view.tenants[index];
        self.view.clock = tenant.next.max(self.view.clock);
        tenant.running += 1;
        tenant.next = self.view.clock + 1.0 / weight;
        let turn = Turn { tenant: tenant.name.clone(), served: self.view.clock, next: tenant.next };
        self.turns.insert(index, turn);
    }
}
