//! The list of jobs, a page at a time.

use axum::Json;
use axum::extract::State as Extract;
use axum::http::{HeaderName, HeaderValue, Uri, header};
use axum::response::IntoResponse;
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
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
/// Largest number of jobs on a page.
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
        (status = 200, description = "A page of jobs", body = JobList, headers(
            ("Link" = String, description = "The next page, `rel=\"next\"`; absent on the last"),
        )),
        (status = 422, response = Problematic),
    ),
)]
pub(crate) async fn list(Extract(shared): App, caller: Caller, uri: Uri) -> Answer {
    let ListParameters { state, cursor, limit } = query::read(&uri)?;
    let limit = limit.unwrap_or(PAGE);
    if !(1..=MAX_PAGE).contains(&limit) {
        return Err(Error::parameter(format_args!("limit must be 1 to {MAX_PAGE}, not {limit}")).into());
    }
    let query = ListQuery { tenant: caller.tenant()?.name.clone(), state, cursor, limit };
    let page = shared.store.list(&query).await?;
    let link = page.next.as_ref().and_then(|next| next_page(&query, next));
    let jobs = page.jobs.into_iter().map(|job| JobView::new(&shared, job)).collect();
    Ok((link, Json(JobList { jobs, next: page.next })).into_response())
}

/// The `Link` header of a page that has a next one (RFC 8288).
fn next_page(query: &ListQuery, cursor: &str) -> Option<[(HeaderName, HeaderValue); 1]> {
    let state = query.state.map(|state| format!("state={}&", state.name())).unwrap_or_default();
    let cursor = utf8_percent_encode(cursor, NON_ALPHANUMERIC);
    let link = format!("</v1/jobs?{state}limit={}&cursor={cursor}>; rel=\"next\"", query.limit);
    Some([(header::LINK, HeaderValue::try_from(link).ok()?)])
}
