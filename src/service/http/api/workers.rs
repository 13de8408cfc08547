//! The list of workers, for the operator.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use axum::Json;
use axum::extract::State as Extract;
use serde::Serialize;
use utoipa::ToSchema;

use crate::guard::problem::Answer;
use crate::http::state::App;
use crate::ops::timestamp::rfc3339;
use crate::store::{JobId, Worker, WorkerId};

/// A process that works on jobs.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Worker)]
pub(crate) struct WorkerView {
    /// Which one: new at every start of the process.
    id: WorkerId,
    /// Its name, as jobs tell it; several may have the same.
    name: String,
    /// Its version.
    #[schema(example = "0.1.0")]
    version: String,
    /// Name of its device; null where its version does not tell.
    device: Option<String>,
    /// When it was first heard of.
    #[schema(format = DateTime)]
    started_at: String,
    /// When it was last heard of: seconds ago, unless it was killed or has no connection to the store of jobs.
    #[schema(format = DateTime)]
    seen_at: String,
    /// Its running jobs, of all tenants.
    jobs: Vec<JobId>,
}

impl From<Worker> for WorkerView {
    fn from(worker: Worker) -> Self {
        Self {
            id: worker.id,
            name: worker.name,
            version: worker.version,
            device: worker.device,
            started_at: rfc3339(worker.started_at),
            seen_at: rfc3339(worker.seen_at),
            jobs: worker.jobs,
        }
    }
}

/// The workers.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct WorkerList {
    /// The workers, the oldest first.
    workers: Vec<WorkerView>,
}

/// List workers
///
/// The processes that work on jobs of this store, front ends aside, that were heard of in the last five minutes or have
/// jobs. Needs a token that was made with `--metrics`.
#[utoipa::path(
    get, path = "/v1/workers", tag = "service", operation_id = "listWorkers",
    responses((status = 200, description = "The workers", body = WorkerList)),
)]
pub(crate) async fn list(Extract(shared): App) -> Answer<Json<WorkerList>> {
    let workers = shared.store.workers().await?.into_iter().map(WorkerView::from).collect();
    Ok(Json(WorkerList { workers }))
}
