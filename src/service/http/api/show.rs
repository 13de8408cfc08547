//! One job.

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, StatusCode};

use super::view::{JobView, answer};
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
pub(crate) async fn show(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer {
    let job = shared.job(&caller, &id).await?;
    Ok(answer(&shared, StatusCode::OK, HeaderMap::new(), job))
}
