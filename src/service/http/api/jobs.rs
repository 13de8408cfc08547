//! The jobs of a tenant: one, a page of them, their end or deletion, and another run.

use axum::Json;
use axum::extract::{Path, State as Extract};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use tesserae_mesh::error::{Error, Kind};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::parameters::Parameters;
use utoipa::{IntoParams, ToSchema};

use crate::files::{self, job_blobs};
use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problem, Problematic};
use crate::guard::query;
use crate::http::state::{App, Found, Shared};
use crate::ops::rfc3339;
use crate::store::{Deletion, Job, JobId, ListQuery, Progress, State, no_such_job, not_failed};
use crate::work::urls::{self, Urls};

/// A job.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Job)]
pub(crate) struct JobView {
    /// Its name.
    id: JobId,
    /// Where it is in its life.
    state: State,
    /// Place among your own waiting jobs, in the order in which they start: 1 for the next one; null when it does not
    /// wait. Jobs of other tenants are not counted.
    #[schema(minimum = 1)]
    queue_position: Option<u64>,
    /// Of your waiting jobs, those with a higher priority start first: -100 to 100.
    #[schema(minimum = -100, maximum = 100)]
    priority: i8,
    /// Number of the last attempt, which `progress` and the results are of; 0 before the first.
    attempt: u32,
    /// Name of the process that makes, or made, that attempt; null before the first.
    worker: Option<String>,
    /// How far it is.
    progress: Progress,
    /// Whether its cancellation was requested.
    cancel_requested: bool,
    /// Why it failed.
    problem: Option<Problem>,
    /// What it gave; null before it has succeeded.
    result: Option<ResultView>,
    /// The parameters of the request.
    parameters: Parameters,
    /// What was uploaded.
    mesh: MeshView,
    /// When it was accepted.
    #[schema(format = DateTime)]
    created_at: String,
    /// When it was taken from the queue.
    #[schema(format = DateTime)]
    started_at: Option<String>,
    /// When it ended.
    #[schema(format = DateTime)]
    ended_at: Option<String>,
    /// When it will be deleted with its results; null before its end, and where nothing is deleted by itself.
    #[schema(format = DateTime)]
    expires_at: Option<String>,
    /// Files that are made of its mesh before that is gone.
    outputs: Vec<String>,
    /// Whether its mesh or image is kept with the result.
    keep_mesh: bool,
    /// Where everything about it is.
    urls: Urls,
}

/// What a job gave.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = ResultSummary)]
pub(crate) struct ResultView {
    /// Faces of the mesh, or items of the points, each with a label.
    faces: u64,
    /// Clusters, none of them empty; of a whole hierarchy, that of its roots.
    clusters: u64,
}

/// What was uploaded.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = UploadedMesh)]
pub(crate) struct MeshView {
    /// Name that the client gave the file.
    file_name: Option<String>,
    /// Its format.
    format: InputFormat,
    /// Its length.
    bytes: u64,
    /// Names of the buffers that came with it.
    buffers: Vec<String>,
}

pub(crate) fn answer(shared: &Shared, status: StatusCode, job: Job) -> Response {
    (status, Json(JobView::new(shared, job))).into_response()
}

impl JobView {
    pub fn new(shared: &Shared, job: Job) -> Self {
        let (path, urls, retention) = (urls::path(job.id), Urls::of(&job), shared.settings.storage.retention());
        Self {
            id: job.id,
            state: job.state,
            queue_position: job.queue_position,
            priority: job.spec.priority,
            attempt: job.attempt,
            worker: job.worker,
            progress: job.progress,
            cancel_requested: job.cancel_requested,
            problem: job.problem.map(|error| Problem::new(&error, &path)),
            result: job.summary.map(|summary| ResultView { faces: summary.faces, clusters: summary.clusters }),
            parameters: job.spec.parameters,
            mesh: MeshView {
                file_name: job.spec.file_name,
                format: job.spec.format,
                bytes: job.spec.bytes,
                buffers: job.spec.buffers,
            },
            created_at: rfc3339(job.created_at),
            started_at: job.started_at.map(rfc3339),
            ended_at: job.ended_at.map(rfc3339),
            expires_at: job.ended_at.and_then(|ended| ended.checked_add(retention?)).map(rfc3339),
            outputs: job.spec.kept.outputs,
            keep_mesh: job.spec.kept.mesh,
            urls,
        }
    }
}

/// Look at a job
///
/// Where it is in its life and how far.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "getJob",
    responses((status = 200, description = "The job", body = JobView)),
)]
pub(crate) async fn show(Found { shared, job }: Found) -> Json<JobView> {
    Json(JobView::new(&shared, job))
}

/// A page of jobs.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct JobList {
    /// The jobs, newest first.
    jobs: Vec<JobView>,
    /// Give this as `cursor` to get the next page; null on the last.
    next: Option<String>,
}

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
    responses((status = 200, description = "A page of jobs", body = JobList)),
)]
pub(crate) async fn list(Extract(shared): App, caller: Caller, uri: Uri) -> Answer<Json<JobList>> {
    let ListParameters { state, cursor, limit } = query::read(&uri)?;
    let limit = limit.unwrap_or(50);
    if !(1..=1000).contains(&limit) {
        return Err(Error::parameter(format_args!("limit must be 1 to 1000, not {limit}")).into());
    }
    let page = shared.store.list(&ListQuery { tenant: caller.0.name.clone(), state, cursor, limit }).await?;
    let jobs = page.jobs.into_iter().map(|job| JobView::new(&shared, job)).collect();
    Ok(Json(JobList { jobs, next: page.next }))
}

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
    ),
)]
pub(crate) async fn remove(Extract(shared): App, caller: Caller, Path(id): Path<String>, uri: Uri) -> Answer {
    let RemoveQuery { cancel } = query::read(&uri)?;
    let id = shared.job(&caller, &id).await?.id;
    if !cancel {
        match job_blobs::delete(&shared.files, &shared.store, id).await? {
            Deletion::Unknown => return Err(no_such_job(id).into()),
            Deletion::Deleted => return Ok(StatusCode::NO_CONTENT.into_response()),
            Deletion::Live => {}
        }
    }
    let job = job_blobs::cancel(&shared.files, &shared.store, id).await?.ok_or_else(|| no_such_job(id))?;
    // it waited: no worker ends it
    if job.state == State::Cancelled && !job.spec.is_small {
        shared.files.remove_upload(id).await;
    }
    Ok(answer(&shared, StatusCode::ACCEPTED, job))
}

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
    shared.refuse_when_stopping()?;
    let job = shared.job(&caller, &id).await?;
    if job.state != State::Failed {
        return Err(not_failed(job.state).into());
    }
    let is_there = job.keeps_upload()
        && match job_blobs::upload(&shared.files, &shared.store, &job, files::MESH, None).await {
            Err(error) if error.kind == Kind::NotFound => false,
            found => found.map(|_| true)?,
        };
    if !is_there {
        let message = "the upload of this job is not kept any more, as it is only for jobs that were given up \
                       (/problems/poison) or whose files could not be read or written \
                       (/problems/insufficient-storage); submit the mesh again";
        return Err(Error::conflict(message).into());
    }
    let job = shared.store.retry(job.id, shared.most_waiting(&caller.0)).await?;
    Ok(answer(&shared, StatusCode::ACCEPTED, job))
}
