//! The list of workers, for the operator.

use axum::Json;
use axum::extract::State as Extract;
use serde::Serialize;
use utoipa::ToSchema;

use crate::guard::problem::Answer;
use crate::http::state::App;
use crate::store::Worker;

/// The workers.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct WorkerList {
    /// The workers, the oldest first.
    workers: Vec<Worker>,
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
    Ok(Json(WorkerList { workers: shared.store.workers().await? }))
}
