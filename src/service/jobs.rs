//! The jobs: submit, list, look at, cancel and delete.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use axum::extract::{Path, Request, State as Extract};
use axum::http::{HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::{Json, http::HeaderMap};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::{Deserialize, Serialize};
use tracing::Instrument as _;
use utoipa::{IntoParams, ToSchema};

use super::access::Caller;
use super::audit::{self, Action};
use super::intake::Rules;
use super::openapi::{Binary, Problematic};
use super::problem::{Answer, Failure, Problem};
use super::server::{App, Shared};
use super::store::{Created, Deletion, Job, JobId, ListQuery, NewJob, State, no_such_job};
use super::timestamp::rfc3339;
use super::trace::TraceParent;
use super::upload::{self, Upload};
use super::{admission, deletion, idempotency, intake, prefer, query};
use crate::error::{Error, Kind, Result};
use crate::mesh::Format;
use crate::parameters::Parameters;
use crate::report::Phase;

/// Jobs on a page when the request does not say.
const PAGE: usize = 50;
/// Largest number of jobs on a page.
const MAX_PAGE: usize = 1000;

/// A job.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Job)]
pub(super) struct JobView {
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
    progress: ProgressView,
    /// Whether someone asked for its end.
    cancel_requested: bool,
    /// Why it failed.
    problem: Option<Problem>,
    /// What it gave; null before it has succeeded.
    result: Option<ResultView>,
    /// What is asked for.
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
    /// Where everything about it is.
    urls: Urls,
}

/// How far a job is.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Progress)]
pub(super) struct ProgressView {
    /// Iterations made.
    iterations: u32,
    /// Phase of the last of them.
    phase: Option<Phase>,
    /// Hierarchies: rounds made.
    rounds: u32,
    /// Hierarchies: clusters left after the last of them.
    clusters_left: Option<u64>,
    /// Energy after the last iteration or round.
    energy: Option<f64>,
}

/// What a job gave.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = ResultSummary)]
pub(super) struct ResultView {
    /// Faces of the mesh, each with a label.
    faces: u64,
    /// Clusters, none of them empty; of a whole hierarchy, that of its roots.
    clusters: u64,
}

/// What was uploaded.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = UploadedMesh)]
pub(super) struct MeshView {
    /// Name that the client gave the file.
    file_name: Option<String>,
    /// Its format.
    format: Format,
    /// Its length.
    bytes: u64,
    /// Names of the buffers that came with it.
    buffers: Vec<String>,
}

/// Where everything about a job is: paths on this service.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Urls {
    /// The job itself.
    #[serde(rename = "self")]
    #[schema(rename = "self")]
    job: String,
    /// Its events.
    events: String,
    /// Its labels, once it has succeeded; of a whole hierarchy, with `?clusters=K`.
    labels: String,
    /// Its hierarchy, once it has succeeded; null for flat algorithms.
    hierarchy: Option<String>,
    /// Its report, once it has succeeded.
    report: String,
}

/// A page of jobs.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct JobList {
    /// The jobs, newest first.
    jobs: Vec<JobView>,
    /// Give this as `cursor` to get the next page; null on the last.
    next: Option<String>,
}

/// The query of the list of jobs.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListParameters {
    /// Only jobs in this state
    state: Option<State>,
    /// Go on where an earlier page ended: its `next`
    #[param(min_length = 1)]
    cursor: Option<String>,
    /// At most so many jobs; 50 when left out
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<usize>,
}

/// The form of an upload.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form for openapi.yaml; the parts are read one by one")]
pub(super) struct UploadForm {
    /// The mesh: OBJ, GLB or glTF, recognised by media type, file name or content.
    #[schema(value_type = Binary)]
    mesh: Binary,
    /// What to do; the same names as in the query. A parameter may stand in both with the same value only.
    parameters: Option<Parameters>,
    /// Buffers that a `.gltf` refers to: the file name of each part is the URI, percent-decoded.
    #[schema(value_type = Option<Vec<Binary>>)]
    buffer: Option<Vec<Binary>>,
    /// Listed seeds, one face number a cluster: `.npy`, a JSON array, or numbers in text.
    #[schema(value_type = Option<Binary>)]
    seeds: Option<Binary>,
    /// Weights that areas are multiplied by, so that clusters are smaller where they are larger: `.npy` with floats above 0,
    /// one a face or one a vertex, whose mean a face takes.
    #[schema(value_type = Option<Binary>)]
    weights: Option<Binary>,
}

/// The job with that id, if it is the caller's: another's is not there. The only way from an id to a job.
pub(super) async fn find(shared: &Shared, caller: &Caller, id: &str) -> Result<Job> {
    let id: JobId = id.parse()?;
    let tenant = caller.tenant()?;
    let job = shared.store.get(id).await?.filter(|job| job.spec.tenant == tenant.name);
    job.ok_or_else(|| no_such_job(id))
}

/// Path of a job.
pub(super) fn path(id: JobId) -> String {
    format!("/v1/jobs/{id}")
}

/// When a job will be deleted.
pub(super) fn expires_at(shared: &Shared, job: &Job) -> Option<SystemTime> {
    job.ended_at?.checked_add(shared.settings.storage.retention()?)
}

/// Says in the headers of an answer about a job when there will be none any more.
pub(super) fn tell_expiry(response: &mut Response, shared: &Shared, job: &Job) {
    let expires = expires_at(shared, job).and_then(|time| HeaderValue::try_from(httpdate::fmt_http_date(time)).ok());
    if let Some(expires) = expires {
        response.headers_mut().insert(header::EXPIRES, expires);
    }
}

/// A job as an answer.
pub(super) fn answer(shared: &Shared, status: StatusCode, headers: HeaderMap, job: Job) -> Response {
    let view = JobView::new(shared, job.clone());
    let mut response = (status, headers, Json(view)).into_response();
    tell_expiry(&mut response, shared, &job);
    response
}

impl JobView {
    fn new(shared: &Shared, job: Job) -> Self {
        let path = path(job.id);
        let expires_at = expires_at(shared, &job).map(rfc3339);
        let is_hierarchical = job.spec.parameters.algorithm.is_hierarchical();
        Self {
            id: job.id,
            state: job.state,
            queue_position: job.queue_position,
            priority: job.spec.priority,
            attempt: job.attempt,
            worker: job.worker,
            progress: ProgressView {
                iterations: job.progress.iterations,
                phase: job.progress.phase,
                rounds: job.progress.rounds,
                clusters_left: job.progress.clusters_left,
                energy: job.progress.energy,
            },
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
            expires_at,
            urls: Urls {
                events: format!("{path}/events"),
                labels: format!("{path}/labels"),
                hierarchy: is_hierarchical.then(|| format!("{path}/hierarchy")),
                report: format!("{path}/report"),
                job: path,
            },
        }
    }
}

/// Submit a mesh
///
/// The body is the mesh, or a form with the mesh and more. `Prefer: wait=N` waits up to N seconds for the job's end: 200
/// with the ended job, the problem of a failed one, or 202 when it takes longer.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs", operation_id = "createJob",
    params(
        ("format" = Option<Format>, Query, description = "Format of the mesh, where its media type does not say it"),
        ("priority" = Option<i8>, Query, minimum = -100, maximum = 100, description = "Of your waiting jobs, those with a higher priority start first; 0 when left out"),
        ("webhook" = Option<String>, Query, description = "URL that is told the end of the job, signed as Standard Webhooks says; on a host that the operator allows"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when the job has ended, or after N seconds"),
        ("Idempotency-Key" = Option<String>, Header, description = "A string that is new with every new request: the same request with the same key gives the same job as long as that is kept, another request 422"),
    ),
    request_body(description = "The mesh, or a form", content(
        (inline(Binary) = "model/obj"),
        (inline(Binary) = "model/gltf-binary"),
        (inline(Binary) = "model/gltf+json"),
        (inline(Binary) = "application/octet-stream"),
        (UploadForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The job has succeeded, or was cancelled, while the request waited for it", body = JobView,
         headers(("Location" = String, description = "Path of the job"), ("Preference-Applied" = String, description = "`wait`"))),
        (status = 202, description = "The job was accepted", body = JobView,
         headers(("Location" = String, description = "Path of the job"))),
        (status = 400, response = Problematic),
        (status = 409, response = Problematic),
        (status = 413, response = Problematic),
        (status = 415, response = Problematic),
        (status = 422, response = Problematic),
        (status = 429, response = Problematic),
        (status = 500, response = Problematic),
        (status = 503, response = Problematic),
        (status = 507, response = Problematic),
    ),
)]
pub(super) async fn create(Extract(shared): App, caller: Caller, request: Request) -> Answer {
    if shared.stop.is_cancelled() {
        return Err(stopping().into());
    }
    let tenant = caller.tenant()?.clone();
    let key = idempotency::key(request.headers())?;
    let is_known = match &key {
        Some(key) => shared.store.knows_key(&tenant.name, key).await?,
        None => false,
    };
    let uploads = Arc::clone(&shared.traffic.uploads);
    let rules = Rules::new(shared.settings.max_upload_bytes, &shared.settings.traffic, uploads);
    if !is_known {
        let bytes = upload::content_length(request.headers()).unwrap_or(0);
        let room = match admission::check(&shared, &tenant).await {
            // before the disk: an upload over the limit says nothing about the disk
            Ok(()) if bytes > rules.limit => Err(rules.too_large(bytes).into()),
            Ok(()) => shared.files.check_room(bytes).map_err(Failure::from),
            Err(full) => Err(full),
        };
        if let Err(refusal) = room {
            intake::refuse(request);
            return Err(refusal);
        }
    }
    let wait = prefer::wait(request.headers(), shared.settings.max_wait());
    let parent = request.extensions().get::<TraceParent>().map(|parent| parent.at(&tracing::Span::current()));
    let mut upload = upload::receive(request, &shared.files, &tenant.name, key.is_some(), rules).await?;
    upload.spec.trace_parent = parent.map(|parent| parent.to_string());
    if let Some(webhook) = &upload.spec.webhook {
        shared.webhooks.check(webhook)?;
    }
    // On a task of its own, so that a client who hangs up now leaves no half of it.
    let job = tokio::spawn(accept(Arc::clone(&shared), caller, upload, key).in_current_span())
        .await
        .map_err(|error| Error::new(Kind::Internal, format_args!("the job was not accepted: {error}")))??;
    let location = path(job.id);
    let job = match wait {
        Some(wait) => wait_for_end(&shared, job, wait).await?,
        None => job,
    };
    let mut headers = HeaderMap::new();
    if let Ok(value) = HeaderValue::from_str(&location) {
        headers.insert(header::LOCATION, value);
    }
    if !job.state.is_ended() {
        return Ok(answer(&shared, StatusCode::ACCEPTED, headers, job));
    }
    if wait.is_some() {
        headers.insert("preference-applied", HeaderValue::from_static("wait"));
    }
    Ok(match job.problem {
        Some(error) => (headers, Failure { instance: Some(location), ..error.into() }).into_response(),
        None => answer(&shared, StatusCode::OK, headers, job),
    })
}

/// Makes a job of an upload, or finds the one that was made of it before.
async fn accept(shared: Arc<Shared>, caller: Caller, upload: Upload, key: Option<String>) -> Result<Job, Failure> {
    let tenant = caller.tenant()?;
    let Upload { mut folder, mut spec, digests } = upload;
    let is_known = match &key {
        Some(key) => shared.store.knows_key(&tenant.name, key).await?,
        None => false,
    };
    let _place = match is_known {
        true => None,
        false => Some(admission::place(&shared, tenant).await?),
    };
    let idempotency = key.map(|key| idempotency::idempotency(key, &spec, &digests)).transpose()?;
    let id = folder.id();
    if !is_known {
        folder.promise(&spec, shared.settings.max_faces)?;
    }
    let upload = folder.settle(|bytes| shared.store.takes(bytes)).await?;
    spec.is_small = !upload.is_empty();
    match shared.store.create(NewJob { id, spec, idempotency, upload }).await {
        Ok(Created::New(job)) => {
            folder.keep();
            audit::record(Action::Accepted(job.spec.bytes), &caller, id);
            shared.metrics.accepted(&job);
            Ok(job)
        }
        Ok(Created::Known(job)) => {
            audit::record(Action::Repeated, &caller, job.id);
            Ok(job)
        }
        Err(error) => Err(admission::full(&shared, error).await),
    }
}

/// The job after it ended, or after a while.
async fn wait_for_end(shared: &Shared, job: Job, wait: Duration) -> Result<Job> {
    let Some(mut pulses) = shared.store.watch(job.id).await? else {
        return Ok(job);
    };
    tokio::select! {
        _ = pulses.wait_for(|pulse| pulse.ended) => {}
        () = tokio::time::sleep(wait) => {}
        () = shared.stop.cancelled() => {}
    }
    Ok(shared.store.get(job.id).await?.unwrap_or(job))
}

/// The error of a service that is about to end.
pub(super) fn stopping() -> Error {
    Error::new(Kind::Unavailable, "the service is stopping")
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
        (status = 500, response = Problematic),
    ),
)]
pub(super) async fn list(Extract(shared): App, caller: Caller, uri: Uri) -> Answer {
    let ListParameters { state, cursor, limit } = query::read(&uri)?;
    let limit = limit.unwrap_or(PAGE);
    if !(1..=MAX_PAGE).contains(&limit) {
        return Err(Error::parameter(format_args!("limit must be 1 to {MAX_PAGE}, not {limit}")).into());
    }
    let query = ListQuery { tenant: Some(caller.tenant()?.name.clone()), state, cursor, limit };
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

/// Look at a job
///
/// Where it is in its life and how far.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "getJob",
    params(("id" = String, Path, format = "uuid", description = "Id of the job")),
    responses(
        (status = 200, description = "The job", body = JobView),
        (status = 404, response = Problematic),
        (status = 500, response = Problematic),
    ),
)]
pub(super) async fn show(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer {
    let job = find(&shared, &caller, &id).await?;
    Ok(answer(&shared, StatusCode::OK, HeaderMap::new(), job))
}

/// Cancel or delete a job
///
/// A job that has not ended is cancelled: it ends soon and stays in the list. One that has ended is deleted with its
/// results; what its webhook is still to be told is told all the same.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "deleteJob",
    params(("id" = String, Path, format = "uuid", description = "Id of the job")),
    responses(
        (status = 202, description = "The job will be cancelled", body = JobView),
        (status = 204, description = "The job was deleted"),
        (status = 404, response = Problematic),
        (status = 500, response = Problematic),
    ),
)]
pub(super) async fn remove(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer<Response> {
    let id = find(&shared, &caller, &id).await?.id;
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
            if job.state == State::Cancelled {
                // it waited: no worker ends it
                shared.files.give_back(id);
                if !job.spec.is_small {
                    shared.files.remove_upload(id).await;
                }
            }
            Ok(answer(&shared, StatusCode::ACCEPTED, HeaderMap::new(), job))
        }
    }
}
