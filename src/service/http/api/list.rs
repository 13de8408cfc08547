//! The list of jobs, a page at a time.

use axum::Json;
use axum::extract::State as Extract;
use axum::http::Uri;
use serde::{Deserialize, Serialize};
use tesserae_mesh::error::Error;
use utoipa::{IntoParams, ToSchema};

use super::view::JobView;
use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problematic};
use crate::guard::query;
use crate::http::state::App;
use crate::store::{ListQuery, State};

/// Jobs on a page when the request does not say.
const PAGE: usize = 50;
const MAX_PAGE: usize = 1000;

/// A page of jobs.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct JobList {
    /// The jobs, newest first.
    jobs: Vec<JobView>,
    /// Give this as `cursor` to get the next page; null on the last.
    next: Option<String>,
}

/// The query of the list of jobs.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct ListParameters {
    /// Only jobs in this state
    state: Option<State>,
    /// Go on where an earlier page ended: its `next`
    #[param(min_length = 1)]
    cursor: Option<String>,
    /// Largest number of jobs; 50 when left out
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<usize>,
}

/// List jobs
///
/// Newest first, a page at a time.
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs", operation_id = "listJobs",
    params(ListParameters),
    responses(
        (status = 200, description = "A page of jobs", body = JobList),
        (status = 422, response = Problematic),
    ),
)]
pub(crate) async fn list(Extract(shared): App, caller: Caller, uri: Uri) -> Answer<Json<JobList>> {
    let ListParameters { state, cursor, limit } = query::read(&uri)?;
    let limit = limit.unwrap_or(PAGE);
    if !(1..=MAX_PAGE).contains(&limit) {
        return Err(Error::parameter(format_args!("limit must be 1 to {MAX_PAGE}, not {limit}")).into());
    }
    let query = ListQuery { tenant: caller.tenant()?.name.clone(), state, cursor, limit };
    let page = shared.store.list(&query).await?;
    let jobs = page.jobs.into_iter().map(|job| JobView::new(&shared, job)).collect();
    Ok(Json(JobList { jobs, next: page.next }))
}
