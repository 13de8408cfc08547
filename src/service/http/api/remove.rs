//! The end of a job, or of an ended job its deletion.

use axum::extract::{Path, State as Extract};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

use super::view::{JobView, answer};
use crate::files::job_blobs;
use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problematic};
use crate::guard::query;
use crate::http::state::App;
use crate::store::{Deletion, State, no_such_job};

/// The query of a deletion.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct RemoveQuery {
    /// Only cancel: a job that has ended stays
    #[serde(default)]
    #[param(required = false)]
    cancel: bool,
}

/// Cancel or delete a job
///
/// A job that has not ended is cancelled: it ends soon and stays in the list. One that has ended is deleted with its
/// results; its webhook is still called. With `cancel=true` it stays as it is.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "deleteJob",
    params(RemoveQuery),
    responses(
        (status = 202, description = "The job will be cancelled, or had ended (`cancel=true`)", body = JobView),
        (status = 204, description = "The job was deleted"),
        (status = 422, response = Problematic),
    ),
)]
pub(crate) async fn remove(Extract(shared): App, caller: Caller, Path(id): Path<String>, uri: Uri) -> Answer<Response> {
    let RemoveQuery { cancel } = query::read(&uri)?;
    let id = shared.job(&caller, &id).await?.id;
    if !cancel {
        match job_blobs::delete(&shared.files, shared.store.as_ref(), id).await? {
            Deletion::Unknown => return Err(no_such_job(id).into()),
            Deletion::Deleted => return Ok(StatusCode::NO_CONTENT.into_response()),
            Deletion::Live => {}
        }
    }
    let cancelled = job_blobs::cancel(&shared.files, shared.store.as_ref(), id).await?;
    let job = cancelled.ok_or_else(|| no_such_job(id))?;
    // it waited: no worker ends it
    if job.state == State::Cancelled && !job.spec.is_small {
        shared.files.remove_upload(id).await;
    }
    Ok(answer(&shared, StatusCode::ACCEPTED, job))
}
