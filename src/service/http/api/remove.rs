//! The end of a job, or of an ended job its deletion.

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};

use super::view::{JobView, answer};
use crate::files::deletion;
use crate::guard::access::Caller;
use crate::guard::audit::{self, Action};
use crate::guard::problem::Answer;
use crate::http::state::App;
use crate::store::{Deletion, State, no_such_job};

/// Cancel or delete a job
///
/// A job that has not ended is cancelled: it ends soon and stays in the list. One that has ended is deleted with its
/// results; its webhook is still called.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "deleteJob",
    responses(
        (status = 202, description = "The job will be cancelled", body = JobView),
        (status = 204, description = "The job was deleted"),
    ),
)]
pub(crate) async fn remove(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer<Response> {
    let id = shared.job(&caller, &id).await?.id;
    match deletion::delete(&shared.files, shared.store.as_ref(), id).await? {
        Deletion::Unknown => Err(no_such_job(id).into()),
        Deletion::Deleted => {
            audit::record(Action::Deleted, &caller, id);
            Ok(StatusCode::NO_CONTENT.into_response())
        }
        Deletion::Live => {
            let cancelled = deletion::cancel(&shared.files, shared.store.as_ref(), id).await?;
            let job = cancelled.ok_or_else(|| no_such_job(id))?;
            audit::record(Action::Cancelled, &caller, id);
            // it waited: no worker ends it
            if job.state == State::Cancelled && !job.spec.is_small {
                shared.files.remove_upload(id).await;
            }
            Ok(answer(&shared, StatusCode::ACCEPTED, HeaderMap::new(), job))
        }
    }
}
