//! A new job from an upload.

use std::time::Duration;

use axum::extract::{Request, State as Extract};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::IntoResponse;
use tesserae_mesh::error::Result;
use tesserae_mesh::job::InputFormat;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

use super::jobs::{JobView, answer};
use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Failure, Problematic};
use crate::http::state::{App, Shared};
use crate::ingest::idempotency;
use crate::ingest::intake::Rules;
use crate::ingest::upload::{self, Upload};
use crate::ops::trace::Origin;
use crate::store::{Created, Job, NewJob};
use crate::work::urls;

/// Bytes.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "describes bodies for openapi.yaml")]
pub(crate) struct Binary(String);

/// The form of an upload.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form for openapi.yaml; the parts are read one by one")]
pub(crate) struct UploadForm {
    /// The mesh: OBJ, GLB, glTF, PLY, STL or OFF, recognised by media type, file name or content.
    mesh: Option<Binary>,
    /// In place of a mesh, points with neighbours: `.npy`, `.npz`, PNG or JPEG, recognised by their first bytes.
    points: Option<Binary>,
    /// What to do; the same names as in the query. A parameter stands in one of the two.
    parameters: Option<JobParameters>,
    /// Buffers that a `.gltf` refers to: the file name of each part is the URI, percent-decoded.
    buffer: Option<Vec<Binary>>,
    /// Listed seeds, one face number a cluster: `.npy`, a JSON array, or numbers in text.
    seeds: Option<Binary>,
    /// Edges between points: a sparse matrix, as `scipy.sparse.save_npz` writes it.
    graph: Option<Binary>,
    /// Weights: `.npy` with floats above 0. Of a mesh, areas are multiplied by them, so that clusters are smaller where
    /// they are larger: one a face or one a vertex, whose mean a face takes. Of points, one an item.
    weights: Option<Binary>,
}

/// Its schema is made of that of the parameters of a clustering.
#[derive(ToSchema)]
struct JobParameters;

/// Submit a mesh or points
///
/// The body is the mesh or the points, or a form with them and more. `Prefer: wait=N` waits up to N seconds for the
/// job's end: 200 with the ended job, the problem of a failed one, or 202 when it takes longer.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs", operation_id = "createJob",
    params(
        ("format" = Option<InputFormat>, Query,
         description = "Format of the mesh or the points, where their media type does not say it"),
        ("mesh_url" = Option<String>, Query, example = "s3://bucket/meshes/horse.glb",
         description = "Object of a bucket that is the mesh, below a prefix that the operator allows; the body is \
                        empty then, or a form without a part `mesh`"),
        ("priority" = Option<i8>, Query, minimum = -100, maximum = 100,
         description = "Of your waiting jobs, those with a higher priority start first; 0 when left out"),
        ("outputs" = Option<String>, Query, example = "mesh.glb,submeshes.zip",
         description = "Files to make of the mesh, a list of names: it is gone when the job has ended. A name without \
                        extension means the first format of that output"),
        ("keep_mesh" = Option<bool>, Query,
         description = "Keep the mesh or the image with the result, so that every output can be made of it later; \
                        false when left out"),
        ("webhook" = Option<String>, Query,
         description = "URL that is called at the end of the job, signed as Standard Webhooks says; on a host that \
                        the operator allows"),
        ("Prefer" = Option<String>, Header,
         description = "`wait=N`: answer when the job has ended, or after N seconds"),
        ("Idempotency-Key" = Option<String>, Header,
         description = "A string that is new with every new request: the same request with the same key gives the same \
                        job as long as that is kept, another request 422"),
    ),
    request_body(description = "The mesh, the points, or a form", content(
        (inline(Binary) = "application/octet-stream"),
        (UploadForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The job has succeeded, or was cancelled: while the request waited for it, or \
         before, where its Idempotency-Key was sent again",
         body = JobView, headers(
            ("Location" = String, description = "Path of the job"),
            ("Preference-Applied" = String, description = "`wait`"),
        )),
        (status = 202, description = "The job was accepted", body = JobView,
         headers(("Location" = String, description = "Path of the job"))),
        (status = 400, response = Problematic),
        (status = 409, response = Problematic),
        (status = 413, response = Problematic),
        (status = 415, response = Problematic),
        (status = 507, response = Problematic),
    ),
)]
pub(crate) async fn create(Extract(shared): App, caller: Caller, request: Request) -> Answer {
    shared.refuse_when_stopping()?;
    let tenant = &caller.0;
    let most_waiting = shared.most_waiting(tenant);
    let key = idempotency::key(request.headers())?;
    let is_known = matches!(&key, Some(key) if shared.store.knows_key(&tenant.name, key).await?);
    let patience = shared.settings.traffic.constants.body_timeout;
    let rules = Rules { limit: shared.settings.max_upload_bytes, patience };
    if !is_known {
        let bytes = upload::content_length(request.headers()).unwrap_or(0);
        shared.store.check_room(&tenant.name, most_waiting).await?;
        // before the disk: an upload over the limit says nothing about the disk
        rules.check(bytes)?;
        shared.files.check_room(bytes, 0)?;
    }
    let wait = wait(request.headers());
    let origin = request.extensions().get::<Origin>().cloned();
    let mut upload = upload::receive(request, &shared.files, &tenant.name, key.is_some(), rules).await?;
    upload.spec.trace_parent = origin.as_ref().map(|origin| origin.trace.to_string());
    if let Some(webhook) = &upload.spec.webhook {
        shared.webhooks.check(webhook)?;
    }
    let job = accept(&shared, upload, key, most_waiting).await?;
    let location = urls::path(job.id);
    let job = match (wait, origin) {
        (Some(wait), Some(origin)) => wait_for_end(&shared, job, wait, &origin.gone).await,
        _ => job,
    };
    let located = [(header::LOCATION, location.clone())];
    if !job.state.is_ended() {
        return Ok((located, answer(&shared, StatusCode::ACCEPTED, job)).into_response());
    }
    let waited = wait.map(|_| [("preference-applied", "wait")]);
    Ok(match job.problem {
        Some(error) => (located, waited, Failure { error, instance: Some(location) }).into_response(),
        None => (located, waited, answer(&shared, StatusCode::OK, job)).into_response(),
    })
}

/// Makes a job of an upload, or finds the one that was made of it before.
async fn accept(shared: &Shared, upload: Upload, key: Option<String>, most_waiting: Option<u64>) -> Result<Job> {
    let Upload { mut folder, mut spec, digests, .. } = upload;
    let idempotency = key.map(|key| idempotency::idempotency(key, &spec, &digests));
    let id = folder.id;
    let upload = folder.settle().await?;
    spec.is_small = !upload.is_empty();
    match shared.store.create(NewJob { id, spec, idempotency, upload, most_waiting }).await {
        Ok(Created::New(job)) => {
            folder.keep();
            shared.metrics.families.upload_bytes.inc_by(job.spec.bytes);
            Ok(job)
        }
        Ok(Created::Known(job)) => Ok(job),
        Err(error) => {
            // its answer may be lost, and the job be there; a sweep removes the upload otherwise
            if shared.store.is_shared() && error.is_of_storage() {
                folder.keep();
            }
            Err(error)
        }
    }
}

/// The job after it ended, or after a while; as it was accepted when the store cannot be read now.
async fn wait_for_end(shared: &Shared, job: Job, wait: Duration, gone: &CancellationToken) -> Job {
    let Ok(Some(mut pulses)) = shared.store.watch(job.id).await else { return job };
    tokio::select! {
        _ = pulses.wait_for(|pulse| pulse.ended) => {}
        () = tokio::time::sleep(wait) => {}
        () = shared.stop.cancelled() => {}
        () = gone.cancelled() => {}
    }
    shared.store.get(job.id).await.ok().flatten().unwrap_or(job)
}

/// The time that the client wants to wait: `wait=N` of the `Prefer` header (RFC 7240), at most a minute, after which
/// proxies give up on an answer. Everything else in it is ignored, as the standard requires.
pub(crate) fn wait(headers: &HeaderMap) -> Option<Duration> {
    let values = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
    let mut waits = values.flat_map(|value| value.split(',')).filter_map(|preference| {
        let (name, rest) = preference.split_once('=')?;
        let value = rest.split(';').next()?.trim().trim_matches('"');
        name.trim().eq_ignore_ascii_case("wait").then(|| value.parse().ok())?
    });
    // the first one counts
    waits.next().map(|seconds: u64| Duration::from_secs(seconds.min(60)))
}

#[cfg(test)]
mod tests {
    use axum::http::{HeaderName, HeaderValue};

    use super::*;

    #[test]
    fn the_first_wait_counts_up_to_the_cap() {
        for (header, expected) in [
            ("wait=5", Some(5)),
            ("respond-async, Wait = \"7\"; x=y, wait=9", Some(7)),
            ("wait=100000", Some(60)),
            ("wait", None),
            ("wait=soon", None),
            ("wait=-1", None),
            ("return=minimal", None),
        ] {
            let headers = HeaderMap::from_iter([(HeaderName::from_static("prefer"), HeaderValue::from_static(header))]);
            assert_eq!(wait(&headers), expected.map(Duration::from_secs), "{header}");
        }
        assert_eq!(wait(&HeaderMap::new()), None);
    }
}
