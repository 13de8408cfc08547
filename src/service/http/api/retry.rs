//! Running a job again that was given up.

use axum::extract::{Path, State as Extract};
use axum::http::StatusCode;
use tesserae_mesh::error::{Error, Kind};

use super::view::{JobView, answer};
use crate::files;
use crate::files::job_blobs;
use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problematic};
use crate::http::state::{App, Shared};
use crate::store::{State, not_failed};

/// Run a failed job again
///
/// A job that was given up (`/problems/poison`), or whose files could not be read or written for ten minutes
/// (`/problems/insufficient-storage`), keeps its upload until it is deleted, so that it can be run again: it waits at
/// its old place in the queue, and no earlier attempt counts. Its events go on after the `end` of the failure. Of all
/// other ended jobs the upload is gone: submit the mesh again.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/retry", tag = "jobs", operation_id = "retryJob",
    responses(
        (status = 202, description = "The job waits again", body = JobView),
        (status = 409, response = Problematic),
        (status = 507, response = Problematic),
    ),
)]
pub(crate) async fn retry(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer {
    if shared.stop.is_cancelled() {
        return Err(Shared::stopping().into());
    }
    let job = shared.job(&caller, &id).await?;
    if job.state != State::Failed {
        return Err(not_failed(job.state).into());
    }
    if !job.keeps_upload() {
        return Err(upload_is_gone().into());
    }
    match job_blobs::upload(&shared.files, shared.store.as_ref(), &job, files::MESH, None).await {
        Ok(_) => {}
        Err(error) if error.kind == Kind::NotFound => return Err(upload_is_gone().into()),
        Err(error) => return Err(error.into()),
    }
    let job = shared.store.retry(job.id, shared.most_waiting(caller.tenant()?)).await?;
    Ok(answer(&shared, StatusCode::ACCEPTED, job))
}

fn upload_is_gone() -> Error {
    Error::new(
        Kind::Conflict,
        "the upload of this job is not kept any more, as it is only for jobs that were given up (/problems/poison) or \
         whose files could not be read or written (/problems/insufficient-storage); submit the mesh again",
    )
}
