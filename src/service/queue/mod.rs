//! The rules of the queue: which state follows which, which job is claimed next, and what a crash counts for.
//!
//! The rules are functions without input or output: a store loads what they need in a transaction, and writes what they
//! return. So they stand once, whatever database keeps the jobs. This module knows nothing of the rest of the service.
//!
//! # The life of a job
//!
//! ```text
//! create ─→ queued ─ claim ─→ running ─ end ─→ succeeded | failed | cancelled ─ delete ─→ gone
//!            │ ↑└──── give back ─┘                           │ │        │
//!            │ │           └──── too often ──────────────────┘ │        │
//!            │ └─────────────────── retry ─────────────────────┘        │
//!            └───────── cancel ─────────────────────────────────────────┘
//! ```
//!
//! [`Standing::apply`] has one arm for each change. Every change of state is a [`JobEvent`], which the store numbers
//! from 1 without gaps and appends in the same transaction: all events together give the state.
//!
//! A claim is a lease: a worker prolongs it by heartbeats, and a job whose lease is over waits again at its old place.
//! The number of the attempt is the fence: a worker that names an earlier one changes nothing. An attempt counts from
//! the moment the worker begins to read the mesh, and only if it failed. After [`Rules::max_attempts`] counted attempts
//! the job has failed.
//!
//! # Which job is claimed
//!
//! A suspect that may start comes before all other jobs. Then the tenant with the fewest running jobs divided by its
//! weight comes first; among equals, the tenant whose virtual time is earliest; then the job with the highest priority,
//! then the oldest one. So a priority orders the jobs of one tenant, and decides between tenants only where these are
//! equal. A tenant at its limit of running jobs is skipped. [`claim()`] has the details.
//!
//! # After a crash
//!
//! 1. The jobs that had begun when their worker crashed become *suspects*: any of them may have killed it. The others
//!    wait again without any mark.
//! 2. The crash counts as an attempt only if a single job had begun ([`crashed`]).
//! 3. A suspect starts alone, after a pause that is always the same; several start one after the other. The worker
//!    waits until its other jobs have ended, and claims nothing else while the suspect runs. Both last 30 seconds at
//!    most after the first crash, and twice as long after each further one (`claim::alone`), even one that counts for
//!    none. In a farm, the worker with the fewest running jobs waits, without a reservation; the others go on.
//!
//! So a crash never counts for a neighbour of the job that caused it. A job that kills its worker some time after its
//! start crashes until the time alone is longer than that, and then each crash counts: it is given up. A job of hours
//! holds its worker up for half a minute, unless it was in many crashes. A worker that is never idle starts a suspect,
//! too, as the time alone is bounded.

mod claim;
mod job;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use self::claim::{Claiming, Picks, Share, Shares, Suspect, Tenant, Turn, View, Waiting, claim};
pub(crate) use self::job::{Change, JobEvent, Rules, Standing, State, crashed, not_yours};
