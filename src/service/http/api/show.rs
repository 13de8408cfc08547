//! One job.

use axum::Json;
use axum::extract::{Path, State as Extract};

use super::view::JobView;
use crate::guard::access::Caller;
use crate::guard::problem::Answer;
use crate::http::state::App;

/// Look at a job
///
/// Where it is in its life and how far.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "getJob",
    responses(
        (status = 200, description = "The job", body = JobView),
    ),
)]
pub(crate) async fn show(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer<Json<JobView>> {
    let job = shared.job(&caller, &id).await?;
    Ok(Json(JobView::new(&shared, job)))
}
