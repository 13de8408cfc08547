//! What the rules of a claim see of the queue.

use std::time::SystemTime;

use super::job::Standing;

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
    /// When its next turn starts, in virtual time: `next` of its last [`Turn`](super::Turn), 0 before the first one.
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
