//! Which tenant is served next: start-time fair queueing over tenants.
//!
//! Two queues use it, each with a [`VirtualTimes`] of its own: claims from the store (one unit a job), and time on the
//! device (seconds). Every tenant has a virtual time that advances by what it used, divided by its weight. A tenant
//! that comes back after a pause starts at the current virtual time: it neither waits for what it did not use, nor gets
//! credit for it. The state is kept in memory only; after a restart all tenants start equal.

use std::collections::HashMap;
use std::sync::Arc;

/// What the operator grants a tenant of the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::service) struct Share {
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
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::service) struct Shares(HashMap<String, Share>);

impl FromIterator<(String, Share)> for Shares {
    fn from_iter<I: IntoIterator<Item = (String, Share)>>(shares: I) -> Self {
        Self(shares.into_iter().collect())
    }
}

impl Shares {
    /// The tenants that have another share than the default one.
    #[cfg(feature = "postgres")]
    pub(super) fn iter(&self) -> impl Iterator<Item = (&str, Share)> {
        self.0.iter().map(|(tenant, share)| (tenant.as_str(), *share))
    }

    /// The share of a tenant.
    pub fn of(&self, tenant: &str) -> Share {
        self.0.get(tenant).copied().unwrap_or_default()
    }
}

/// The virtual times.
#[derive(Debug, Default)]
pub(in crate::service) struct VirtualTimes {
    /// Virtual start time of the tenant that was served last.
    clock: f64,
    /// Virtual time at which each tenant's next turn starts; only those after `clock` matter.
    next: HashMap<Arc<str>, f64>,
}

/// Number of tenants above which those at or before the clock are dropped.
const KEPT: usize = 1024;

impl VirtualTimes {
    /// Virtual time at which the next turn of a tenant starts: smaller is sooner.
    pub fn start(&self, tenant: &str) -> f64 {
        self.next.get(tenant).map_or(self.clock, |next| next.max(self.clock))
    }

    /// A tenant is served: the clock advances to its start.
    pub fn serve(&mut self, tenant: &str) {
        self.clock = self.start(tenant);
    }

    /// A tenant used `amount`, in a unit that is the same for all tenants.
    pub fn charge(&mut self, tenant: &str, amount: f64, share: Share) {
        let next = self.start(tenant) + amount / f64::from(share.weight.max(1));
        if self.next.len() >= KEPT {
            let clock = self.clock;
            self.next.retain(|_, next| *next > clock);
        }
        self.next.insert(tenant.into(), next);
    }
}

/// A tenant with jobs that wait.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Waiting {
    /// Its name.
    pub tenant: String,
    /// Its jobs that run.
    pub running: u64,
}

/// The waiting tenants that come first: fewest running jobs divided by weight, then the earliest virtual time. Those at
/// their limit are left out, and with `newcomers` all that have a running job. Several only when they are equal:
/// priority and age of their first jobs decide then.
pub(super) fn first_tenants(waiting: &[Waiting], times: &VirtualTimes, shares: &Shares, newcomers: bool) -> Vec<usize> {
    let mut best: Option<(f64, f64)> = None;
    let mut found = Vec::new();
    for (index, Waiting { tenant, running }) in waiting.iter().enumerate() {
        let share = shares.of(tenant);
        if share.max_running.is_some_and(|most| *running >= most) || (newcomers && *running > 0) {
            continue;
        }
        let key = (*running as f64 / f64::from(share.weight.max(1)), times.start(tenant));
        match best {
            Some(best) if key > best => continue,
            Some(best) if key == best => {}
            _ => found.clear(),
        }
        best = Some(key);
        found.push(index);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Serves one unit at a time to tenants that always wait; how many each got.
    fn serve(times: &mut VirtualTimes, shares: &Shares, tenants: &[&str], count: usize) -> Vec<usize> {
        let waiting: Vec<Waiting> =
            tenants.iter().map(|tenant| Waiting { tenant: (*tenant).to_owned(), running: 0 }).collect();
        let mut served = vec![0; tenants.len()];
        for _ in 0..count {
            let next = first_tenants(&waiting, times, shares, false)[0];
            times.serve(tenants[next]);
            times.charge(tenants[next], 1.0, shares.of(tenants[next]));
            served[next] += 1;
        }
        served
    }

    #[test]
    fn tenants_are_served_by_weight_and_a_pause_gives_no_credit() {
        let heavy = Share { weight: 3, max_running: None };
        let shares: Shares = [("heavy".to_owned(), heavy)].into_iter().collect();
        let mut times = VirtualTimes::default();
        assert_eq!(serve(&mut times, &shares, &["heavy", "light"], 400), [300, 100]);
        assert_eq!(serve(&mut times, &shares, &["heavy"], 1000), [1000]);
        let after = serve(&mut times, &shares, &["heavy", "light"], 400);
        assert!((98..=102).contains(&after[1]), "{after:?}");
    }

    #[test]
    fn running_jobs_by_weight_come_before_turns_and_limits_before_all() {
        let waiting = |running: [u64; 3]| -> Vec<Waiting> {
            ["a", "b", "c"]
                .iter()
                .zip(running)
                .map(|(name, running)| Waiting { tenant: (*name).into(), running })
                .collect()
        };
        let shares: Shares = [
            ("b".to_owned(), Share { weight: 4, max_running: None }),
            ("c".to_owned(), Share { weight: 1, max_running: Some(0) }),
        ]
        .into_iter()
        .collect();
        let mut times = VirtualTimes::default();
        assert_eq!(first_tenants(&waiting([1, 3, 0]), &times, &shares, false), [1]);
        assert_eq!(first_tenants(&waiting([1, 4, 0]), &times, &shares, false), [0, 1], "equal so far");
        times.charge("a", 1.0, shares.of("a"));
        assert_eq!(first_tenants(&waiting([1, 4, 0]), &times, &shares, false), [1]);
        assert_eq!(first_tenants(&waiting([0, 1, 0]), &times, &shares, true), [0]);
        assert!(first_tenants(&waiting([1, 1, 0]), &times, &shares, true).is_empty());
    }
}
