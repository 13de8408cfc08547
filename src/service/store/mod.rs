//! The store of jobs and their events.
//!
//! [`Store`] is written once, over [`database`]: it keeps jobs in a file (SQLite), or in a database that several
//! services share (PostgreSQL). [`queue`](crate::queue) decides which state follows which, which job is claimed and
//! what a crash counts for. The store knows nothing of HTTP, of files or of devices. It passes the suite in
//! `conformance` on both databases.
//!
//! A worker writes with the [`Ticket`] of its claim; a ticket of a job that has ended or was claimed again writes
//! nothing and gets [`Kind::Conflict`](tesserae_mesh::Kind). Every change of state is an event of the job, appended in
//! the same transaction; events are numbered from 1 without gaps.
//!
//! What queries select by is a column; everything else is JSON, so that a new field of a job needs no new
//! [table](database::MIGRATIONS). Small blobs have a table of their own.
//!
//! # When the answer to a commit is lost
//!
//! An end that was committed is recognised when it is repeated, and so are events, by their numbers, and a new job, by
//! its id. A claim that may have been committed ends with its lease, which nothing prolongs. An upload stays until the
//! sweep when the creation of its job may have been committed.

mod change;
mod claim;
#[cfg(test)]
pub(crate) mod conformance;
mod database;
mod job;
mod jobs;
pub(crate) mod kept;
mod listeners;
mod lists;
pub(crate) mod live;
#[expect(clippy::module_inception, reason = "it is the store")]
mod store;
mod terms;
mod workers;

pub use self::database::StoreUrl;
#[cfg(feature = "postgres")]
pub(crate) use self::database::postgres::address;
pub(crate) use self::job::{
    Contents, Job, JobId, LOCAL_TENANT, PRIORITIES, Progress, Referred, SMALL_BLOBS, SmallBlob, Spec, Summary, Ticket,
    keeps_upload, no_such_job, not_failed,
};
pub(crate) use self::store::Store;
pub(crate) use self::terms::{Created, Deletion, End, Ending, Event, Idempotency, ListQuery, NewJob, Notice, Pulse};
pub(crate) use self::workers::Worker;
pub(crate) use crate::queue::{Claiming, JobEvent, Rules, State};

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;
    use std::time::Duration;

    use super::{JobId, LOCAL_TENANT, NewJob, Rules, Spec, Store, Summary};
    use crate::ops::faults::Faults;
    use crate::store::kept::Kept;
    use tesserae_mesh::job::InputFormat;
    use tesserae_mesh::mesh::Format;
    use tesserae_mesh::parameters::Parameters;

    /// Rules of a store in a test.
    pub const RULES: Rules = Rules { max_queued: 100, max_attempts: 3, crash_pause: Duration::ZERO };

    /// An empty store in a folder, which goes with the test.
    pub async fn store_in(folder: &Path) -> Store {
        Store::open(&folder.join("jobs.sqlite3"), true, RULES, Faults::default()).await.expect("a store")
    }

    pub const SUMMARY: Summary = Summary {
        faces: 12,
        clusters: 7,
        shape: Vec::new(),
        labels_sha256: None,
        is_small: false,
        blobs: BTreeMap::new(),
    };

    /// A job of the tenant `local` like any other.
    pub fn new_job() -> NewJob {
        let spec = Spec {
            tenant: LOCAL_TENANT.to_owned(),
            trace_parent: None,
            webhook: None,
            parameters: Parameters { clusters: Some(7), ..Parameters::default() },
            file_name: None,
            format: InputFormat::Mesh(Format::Obj),
            bytes: 100,
            buffers: Vec::new(),
            listed_seeds: false,
            has_weights: false,
            has_graph: false,
            is_small: false,
            priority: 0,
            kept: Kept::default(),
            referred: None,
        };
        NewJob { id: JobId::random(), spec, idempotency: None, upload: Vec::new(), most_waiting: None }
    }
}
