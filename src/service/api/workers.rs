//! The workers, for the operator: which there are, and draining one.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use axum::Json;
use axum::extract::{Path, State as Extract};
use serde::Serialize;
use utoipa::ToSchema;

use crate::error::{Error, Kind};
use crate::service::access::Caller;
use crate::service::audit::{self, Action};
use crate::service::problem::Answer;
use crate::service::state::{App, Shared};
use crate::service::store::{JobId, Worker, WorkerId};
use crate::service::timestamp::rfc3339;

/// A process that works on jobs.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Worker)]
pub(in crate::service) struct WorkerView {
    /// Which one: new at every start of the process.
    id: WorkerId,
    /// Its name, as jobs tell it; several may have the same.
    name: String,
    /// Its version.
    #[schema(example = "0.1.0")]
    version: String,
    /// Name of its device; null where its version does not tell.
    device: Option<String>,
    /// Whether it claims no more jobs. Without `jobs`, it can be stopped.
    draining: bool,
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
            draining: worker.drains,
            started_at: rfc3339(worker.started_at),
            seen_at: rfc3339(worker.seen_at),
            jobs: worker.jobs,
        }
    }
}

/// The workers.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::service) struct WorkerList {
    /// The workers, the oldest first.
    workers: Vec<WorkerView>,
}

/// List workers
///
/// The processes that work on jobs of this store, front ends aside, that were heard of in the last five minutes or have
/// jobs. Needs a token that was made with `--admin`.
#[utoipa::path(
    get, path = "/v1/workers", tag = "service", operation_id = "listWorkers",
    responses((status = 200, description = "The workers", body = WorkerList)),
)]
pub(in crate::service) async fn list(Extract(shared): App, caller: Caller) -> Answer<Json<WorkerList>> {
    caller.operator()?;
    let workers = shared.store.workers().await?.into_iter().map(WorkerView::from).collect();
    Ok(Json(WorkerList { workers }))
}

/// Drain a worker
///
/// It claims no more jobs, and ends those that it has; it goes on answering requests. It drains until it is resumed or
/// its process ends. Needs a token that was made with `--admin`.
#[utoipa::path(
    post, path = "/v1/workers/{id}/drain", tag = "service", operation_id = "drainWorker",
    responses((status = 200, description = "The worker, with the jobs that it still has", body = WorkerView)),
)]
pub(in crate::service) async fn drain(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
) -> Answer<Json<WorkerView>> {
    set(&shared, &caller, &id, true).await
}

/// Resume a worker
///
/// A worker that drains claims jobs again. Needs a token that was made with `--admin`.
#[utoipa::path(
    delete, path = "/v1/workers/{id}/drain", tag = "service", operation_id = "resumeWorker",
    responses((status = 200, description = "The worker", body = WorkerView)),
)]
pub(in crate::service) async fn resume(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
) -> Answer<Json<WorkerView>> {
    set(&shared, &caller, &id, false).await
}

async fn set(shared: &Shared, caller: &Caller, id: &str, drains: bool) -> Answer<Json<WorkerView>> {
    caller.operator()?;
    let id: WorkerId = id.parse()?;
    let worker = shared.store.drain(id, drains).await?;
    let worker = worker.ok_or_else(|| Error::new(Kind::NotFound, format_args!("there is no such worker: {id}")))?;
    audit::record(if drains { Action::Drained } else { Action::Resumed }, caller, id);
    Ok(Json(worker.into()))
}
