//! The processes that work on jobs: what each says about itself.

use std::fmt;
use std::sync::Arc;
use std::time::SystemTime;

use async_trait::async_trait;
use parking_lot::Mutex;
use serde::{Serialize, Serializer};
use utoipa::ToSchema;
use uuid::Uuid;

use super::job::{JobId, State};
use super::queue::{ListQuery, Queue};
use crate::error::Result;

/// Name of a worker, new at every start of its process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ToSchema)]
#[schema(value_type = String, format = "uuid")]
pub(in crate::service) struct WorkerId(pub(super) Uuid);

impl fmt::Display for WorkerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.as_hyphenated().fmt(f)
    }
}

impl Serialize for WorkerId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// What a process says about itself.
#[derive(Debug, Clone)]
pub(in crate::service) struct Presence {
    /// Its name for clients, which several may have.
    pub name: Arc<str>,
    /// Its version.
    pub version: &'static str,
    /// Name of its device.
    pub device: Arc<str>,
}

/// A process that works on jobs.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) struct Worker {
    /// Which one.
    pub id: WorkerId,
    /// Its name for clients.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Name of its device; none of a version that does not tell.
    pub device: Option<String>,
    /// When it was first heard of.
    pub started_at: SystemTime,
    /// When it was last heard of.
    pub seen_at: SystemTime,
    /// Its running jobs.
    pub jobs: Vec<JobId>,
}

/// Knows the workers.
#[async_trait]
pub(in crate::service) trait Workers: fmt::Debug + Send + Sync {
    /// Says that this process works on jobs; to be repeated every few seconds.
    async fn announce(&self, presence: &Presence) -> Result<()>;

    /// The workers that were heard of in the last minutes or have jobs, the oldest first.
    async fn workers(&self) -> Result<Vec<Worker>>;
}

/// The worker of a store that one process has.
#[derive(Debug)]
pub(super) struct OnlyWorker {
    id: WorkerId,
    /// What it said, first and last.
    known: Mutex<Option<(Presence, SystemTime, SystemTime)>>,
}

impl Default for OnlyWorker {
    fn default() -> Self {
        Self { id: WorkerId(Uuid::new_v4()), known: Mutex::default() }
    }
}

impl OnlyWorker {
    pub fn announce(&self, presence: &Presence) {
        let mut known = self.known.lock();
        let now = SystemTime::now();
        let first = known.as_ref().map_or(now, |(_, first, _)| *first);
        *known = Some((presence.clone(), first, now));
    }

    /// The worker with all running jobs of the store; none before it was announced.
    pub async fn worker(&self, queue: &dyn Queue) -> Result<Option<Worker>> {
        let Some((presence, started_at, seen_at)) = self.known.lock().clone() else { return Ok(None) };
        let running = ListQuery { state: Some(State::Running), limit: 1000, ..ListQuery::default() };
        Ok(Some(Worker {
            id: self.id,
            name: presence.name.to_string(),
            version: presence.version.to_owned(),
            device: Some(presence.device.to_string()),
            started_at,
            seen_at,
            jobs: queue.list(&running).await?.jobs.into_iter().map(|job| job.id).collect(),
        }))
    }
}
