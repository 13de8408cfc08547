//! A job as an answer.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::parameters::Parameters;
use utoipa::ToSchema;

use crate::guard::problem::Problem;
use crate::http::state::Shared;
use crate::ops::timestamp::rfc3339;
use crate::store::{Job, JobId, Progress, State};
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
        let path = urls::path(job.id);
        let retention = shared.settings.storage.retention();
        let urls = Urls::of(&job);
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
