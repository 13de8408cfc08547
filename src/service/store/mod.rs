//! The store of jobs and their events.
//!
//! [`JobStore`] is a whole store; its users take the part that they need: [`Queue`], [`Events`],
//! [`Notices`], [`Workers`] or [`Maintenance`]. Every store passes the suite in `conformance`. A store knows nothing of
//! HTTP, of files or of devices. [`sqlite`] keeps jobs in a file, [`postgres`] in a database that several services
//! share.
//!
//! # The life of a job
//!
//! ```text
//! create ─→ queued ─ claim ─→ running ─ finish ─→ succeeded | failed | cancelled ─ delete ─→ gone
//!            │ ↑└──── release ───┘                              │ │        │
//!            │ │           └──── too often ─────────────────────┘ │        │
//!            │ └─────────────────── retry ────────────────────────┘        │
//!            └───────── cancel ────────────────────────────────────────────┘
//! ```
//!
//! Every change of state is an event of the job, appended in the same step: all events together give the state. Events
//! are numbered from 1 without gaps. A worker writes with the [`Ticket`] of its claim; a ticket of a job that has ended
//! or was claimed again writes nothing and gets [`Kind::Conflict`](crate::Kind).
//!
//! A claim is a lease: a worker prolongs the leases of its jobs by [`heartbeat`](Queue::heartbeat), and jobs whose
//! lease is over are [reclaimed](Queue::reclaim). A released job waits again at its old place in the queue, and its
//! events go on with the next number. An attempt counts from the moment the worker [begins](Queue::begin) to read the
//! mesh; a claim alone never counts. After [`Rules::max_attempts`] counted attempts that failed, the job has failed.
//!
//! # Which job is claimed
//!
//! The tenant with the fewest running jobs divided by its weight comes first; among equals, the tenant whose virtual
//! time is earliest ([`fairness`]); then the job with the highest priority, then the oldest one. So a priority orders
//! the jobs of one tenant, and decides between tenants only where these are equal. A tenant at its limit of running
//! jobs is skipped. Each claimed job costs a pass over the tenants with waiting jobs, and an index look-up for each of
//! the equal tenants.
//!
//! # After a crash
//!
//! A start that finds running jobs follows a crash. Running jobs that had not begun return to the queue without any
//! mark. Those that had begun become *suspects*: any of them may have killed the process. The crash counts as an
//! attempt of a suspect in two cases only: it was the only job that had begun, or the only one of them that was a
//! suspect of two crashes or more. In the second case a job that was claimed after the suspect may be the cause; then
//! the crash counts for neither, unless the suspect was in [five](queue::BLAMED_FROM) crashes, so that a job that kills
//! the process late is given up, too.
//!
//! Suspects start one at a time. Each pauses before, [ten times as long](Rules::pause) after every further crash. After
//! its second crash a suspect runs alone: no other job is claimed while it starts, for [`ALONE`] at most. So a job that
//! kills the process is given up, and its neighbours are not.

#[cfg(test)]
pub(super) mod conformance;
mod cursor;
mod events;
pub(super) mod fairness;
mod job;
mod maintenance;
mod notices;
#[cfg(feature = "postgres")]
pub(super) mod postgres;
mod pulses;
mod queue;
pub(super) mod sqlite;
mod token_rows;
mod url;
mod workers;

pub(super) use self::events::{Event, Events, Pulse, What};
pub(super) use self::job::{
    Contents, Job, JobId, LOCAL_TENANT, PRIORITIES, Progress, Referred, SMALL_BLOBS, SmallBlob, Spec, State, Summary,
    Ticket, keeps_upload, no_such_job,
};
pub(super) use self::maintenance::{Deletion, Maintenance, Statistics};
pub(super) use self::notices::{Notice, Notices};
pub(super) use self::queue::{
    ALONE, Claiming, Created, End, Ending, Idempotency, ListQuery, NewJob, Page, Queue, Release, Retried, Rules,
};
use self::queue::{ALONE_FROM, given_up, guilty, lease_is_over, not_yours, reused_key};
pub(super) use self::token_rows::{TokenRows, TokenStore};
pub use self::url::StoreUrl;
pub(super) use self::workers::{Presence, Worker, WorkerId, Workers};

/// A whole store. See the [module](self) for the life of a job.
pub(super) trait JobStore: Queue + Events + Notices + Workers + Maintenance {}

impl<S: Queue + Events + Notices + Workers + Maintenance> JobStore for S {}

#[cfg(test)]
pub(super) mod tests {
    use std::path::Path;
    use std::time::Duration;

    use super::sqlite::SqliteStore;
    use super::{JobId, LOCAL_TENANT, NewJob, Rules, Spec};
    use crate::mesh::Format;
    use crate::parameters::Parameters;
    use crate::service::faults::Faults;
    use crate::service::kept::Kept;

    /// Rules of a store in a test.
    pub const RULES: Rules = Rules { max_queued: 100, max_attempts: 3, crash_pause: Duration::ZERO };

    /// An empty store in a folder, which goes with the test.
    pub async fn store_in(folder: &Path) -> SqliteStore {
        SqliteStore::temporary(&folder.join("jobs.sqlite3"), RULES, Faults::default()).await.expect("a store")
    }

    /// A job of the tenant `local` like any other.
    pub fn new_job() -> NewJob {
        let spec = Spec {
            tenant: LOCAL_TENANT.to_owned(),
            trace_parent: None,
            webhook: None,
            parameters: Parameters { clusters: Some(7), ..Parameters::default() },
            file_name: None,
            format: Format::Obj,
            bytes: 100,
            buffers: Vec::new(),
            listed_seeds: false,
            has_weights: false,
            is_small: false,
            priority: 0,
            kept: Kept::default(),
            referred: None,
        };
        NewJob { id: JobId::random(), spec, idempotency: None, upload: Vec::new() }
    }
}
