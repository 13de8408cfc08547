//! Claims: which jobs a worker gets.

use std::collections::HashMap;
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
    let mut fair = Fair::new(view.clock, &view.tenants, shares);
    let again = match allowed(&view, *limit, |index| fair.is_below_limit(index), rules, now) {
        Allowed::Nothing(until) => return Picks { again: Some(until), ..Picks::default() },
        Allowed::Suspect(index) => {
            let suspect = view.tenants[index].suspect.map(|suspect| suspect.number);
            fair.serve(index);
            return Picks { numbers: suspect.into_iter().collect(), turns: fair.turns(), again: None };
        }
        Allowed::Others(again) => again,
    };
    let mut numbers = Vec::new();
    while numbers.len() < limit + newcomers {
        let Some((index, number)) = fair.next(numbers.len() >= *limit) else { break };
        fair.serve(index);
        fair.tenants[index].taken += 1;
        numbers.push(number);
    }
    Picks { numbers, turns: fair.turns(), again }
}

/// Start-time fair queueing over tenants (Goyal et al. 1996). A tenant has a virtual time, which each claimed job
/// advances by 1 / weight. A tenant that comes back after a pause starts at the clock: it neither waits for what it did
/// not use, nor gets credit for it.
struct Fair<'v> {
    clock: f64,
    tenants: Vec<Served<'v>>,
}

struct Served<'v> {
    tenant: &'v Tenant,
    share: Share,
    running: u64,
    /// Of its waiting jobs.
    taken: usize,
    next: f64,
    turn: Option<f64>,
}

impl<'v> Fair<'v> {
    fn new(clock: f64, tenants: &'v [Tenant], shares: &Shares) -> Self {
        let served = |tenant: &'v Tenant| {
            let share = shares.get(&tenant.name).copied().unwrap_or_default();
            Served { tenant, share, running: tenant.running, taken: 0, next: tenant.next, turn: None }
        };
        Self { clock, tenants: tenants.iter().map(served).collect() }
    }

    fn is_below_limit(&self, index: usize) -> bool {
        let Served { share, running, .. } = &self.tenants[index];
        share.max_running.is_none_or(|most| *running < most)
    }

    fn next(&self, is_for_newcomer: bool) -> Option<(usize, i64)> {
        let entitled = (0..self.tenants.len()).filter(|index| self.is_below_limit(*index));
        let candidates = entitled.filter_map(|index| {
            let Served { tenant, share, running, taken, next, .. } = &self.tenants[index];
            let job = tenant.waiting.get(*taken).filter(|_| !is_for_newcomer || *running == 0)?;
            let place = *running as f64 / weight(*share);
            Some((place, next.max(self.clock), job, index))
        });
        let first = candidates.min_by(|(place, start, job, _), (other_place, other_start, other_job, _)| {
            place.total_cmp(other_place).then(start.total_cmp(other_start)).then(job.cmp(other_job))
        });
        first.map(|(_, _, job, index)| (index, job.number))
    }

    fn serve(&mut self, index: usize) {
        let tenant = &mut self.tenants[index];
        self.clock = tenant.next.max(self.clock);
        tenant.running += 1;
        tenant.turn = Some(self.clock);
        tenant.next = self.clock + 1.0 / weight(tenant.share);
    }

    fn turns(self) -> Vec<Turn> {
        let turn = |Served { tenant, next, turn, .. }: Served<'_>| {
            turn.map(|served| Turn { tenant: tenant.name.clone(), served, next })
        };
        self.tenants.into_iter().filter_map(turn).collect()
    }
}

fn weight(share: Share) -> f64 {
    f64::from(share.weight.max(1))
}
