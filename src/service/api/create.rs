//! A new job from an upload.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State as Extract};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::IntoResponse;
use tracing::Instrument as _;
use utoipa::ToSchema;

use super::binary::Binary;
use super::view::{JobView, answer};
use crate::error::{Error, Kind};
use crate::mesh::Format;
use crate::parameters::Parameters;
use crate::service::access::Caller;
use crate::service::audit::{self, Action};
use crate::service::intake::Rules;
use crate::service::problem::{Answer, Failure, Problematic};
use crate::service::state::{App, Shared};
use crate::service::store::{Created, Job, NewJob, Spec};
use crate::service::trace::TraceParent;
use crate::service::upload::{self, Upload};
use crate::service::{idempotency, intake, prefer, query, urls};

/// The form of an upload.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form for openapi.yaml; the parts are read one by one")]
pub(in crate::service) struct UploadForm {
    /// The mesh: OBJ, GLB, glTF, PLY or STL, recognised by media type, file name or content.
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
    /// Weights that areas are multiplied by, so that clusters are smaller where they are larger: `.npy` with floats
    /// above 0, one a face or one a vertex, whose mean a face takes.
    #[schema(value_type = Option<Binary>)]
    weights: Option<Binary>,
}

/// Submit a mesh
///
/// The body is the mesh, or a form with the mesh and more. `Prefer: wait=N` waits up to N seconds for the job's end:
/// 200 with the ended job, the problem of a failed one, or 202 when it takes longer.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs", operation_id = "createJob",
    params(
        ("format" = Option<Format>, Query, description = "Format of the mesh, where its media type does not say it"),
        ("upload" = Option<String>, Query,
         description = "Id of an upload by URL (`POST /v1/uploads`) that is the mesh; the body is empty then, or a \
                        form without a part `mesh`. The job gets that id; the same request again gives the same job"),
        ("mesh_url" = Option<String>, Query, example = "s3://bucket/meshes/horse.glb",
         description = "Object of a bucket that is the mesh, below a prefix that the operator allows; the body is \
                        empty then, or a form without a part `mesh`"),
        ("priority" = Option<i8>, Query, minimum = -100, maximum = 100,
         description = "Of your waiting jobs, those with a higher priority start first; 0 when left out"),
        ("outputs" = Option<String>, Query, example = "mesh.glb,submeshes.zip",
         description = "Files to make of the mesh, a list of names: it is gone when the job has ended. A name without \
                        extension means the first format of that output"),
        ("keep_mesh" = Option<bool>, Query,
         description = "Keep the mesh with the result, so that every output can be made of it later; false when left \
                        out"),
        ("webhook" = Option<String>, Query,
         description = "URL that is called at the end of the job, signed as Standard Webhooks says; on a host that \
                        the operator allows"),
        ("Prefer" = Option<String>, Header,
         description = "`wait=N`: answer when the job has ended, or after N seconds"),
        ("Idempotency-Key" = Option<String>, Header,
         description = "A string that is new with every new request: the same request with the same key gives the same \
                        job as long as that is kept, another request 422"),
    ),
    request_body(description = "The mesh, or a form", content(
        (inline(Binary) = "application/octet-stream"),
        (UploadForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The job has succeeded, or was cancelled, while the request waited for it",
         body = JobView, headers(
            ("Location" = String, description = "Path of the job"),
            ("Preference-Applied" = String, description = "`wait`"),
        )),
        (status = 202, description = "The job was accepted", body = JobView,
         headers(("Location" = String, description = "Path of the job"))),
        (status = 400, response = Problematic),
        (status = 404, response = Problematic),
        (status = 409, response = Problematic),
        (status = 413, response = Problematic),
        (status = 415, response = Problematic),
        (status = 422, response = Problematic),
        (status = 507, response = Problematic),
    ),
)]
pub(in crate::service) async fn create(Extract(shared): App, caller: Caller, request: Request) -> Answer {
    if shared.stop.is_cancelled() {
        return Err(Shared::stopping().into());
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
        let is_reserved = query::take(request.uri().query().unwrap_or_default(), "upload").0.is_some();
        let bytes = upload::content_length(request.headers()).unwrap_or(0);
        let room = match shared.admission.check(&tenant, is_reserved).await {
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
    let parent = request.extensions().get::<TraceParent>().map(TraceParent::to_string);
    let mut upload =
        upload::receive(request, &shared.files, shared.store.as_ref(), &tenant.name, key.is_some(), rules).await?;
    upload.spec.trace_parent = parent;
    if let Some(webhook) = &upload.spec.webhook {
        shared.webhooks.check(webhook)?;
    }
    // On a task of its own, so that a client that hangs up now leaves no half of it.
    let job = tokio::spawn(accept(Arc::clone(&shared), caller, upload, key).in_current_span())
        .await
        .map_err(|error| Error::new(Kind::Internal, format_args!("the job was not accepted: {error}")))??;
    let location = urls::path(job.id);
    let job = match wait {
        Some(wait) => wait_for_end(&shared, job, wait).await,
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
    let Upload { mut folder, mut spec, digests, earlier, .. } = upload;
    if let Some(job) = earlier {
        return repeated(&caller, job, &spec);
    }
    let is_known = match &key {
        Some(key) => shared.store.knows_key(&tenant.name, key).await?,
        None => false,
    };
    let _place = match is_known || spec.is_of_upload_by_url() {
        true => None,
        false => Some(shared.admission.place(tenant).await?),
    };
    let idempotency = key.map(|key| idempotency::idempotency(key, &spec, &digests)).transpose()?;
    let id = folder.id();
    if !is_known {
        folder.promise(&spec, &shared.settings.limits())?;
    }
    let upload = folder.settle(|bytes| shared.store.takes(bytes)).await?;
    spec.is_small = !upload.is_empty();
    // of an upload by URL only: other jobs have new ids
    let wanted = spec.is_of_upload_by_url().then(|| spec.clone());
    match shared.store.create(NewJob { id, spec, idempotency, upload }).await {
        Ok(Created::New(job)) => {
            // another service made a job of the same upload in this moment
            if let Some(wanted) = wanted.as_ref().filter(|wanted| !is_same(&job.spec, wanted)) {
                return repeated(&caller, job, wanted);
            }
            folder.keep();
            if let Some(wanted) = wanted {
                // the other service's copy of the parts is the job's
                if let Some(parts) = wanted.parts().filter(|&parts| job.spec.parts() != Some(parts)) {
                    shared.files.remove_parts(id, parts).await;
                }
            }
            audit::record(Action::Accepted(job.spec.bytes), &caller, id);
            shared.metrics.accepted(&job);
            Ok(job)
        }
        Ok(Created::Known(job)) => {
            // a repeated request may have stored the mesh once more
            if wanted.is_some() && job.id != id {
                // a reservation that stays is over after some hours
                if shared.store.unreserve(id).await == Ok(true) {
                    shared.files.remove_upload(id).await;
                }
            }
            audit::record(Action::Repeated, &caller, job.id);
            Ok(job)
        }
        Err(error) => {
            // its answer may be lost, and the job be there; a sweep removes the upload otherwise
            if shared.store.is_shared() && error.is_of_storage() {
                folder.keep();
            }
            Err(shared.admission.full(error).await)
        }
    }
}

/// The job that was made of an upload by URL before: the same request gives the same job.
fn repeated(caller: &Caller, job: Job, spec: &Spec) -> Result<Job, Failure> {
    if is_same(&job.spec, spec) {
        audit::record(Action::Repeated, caller, job.id);
        return Ok(job);
    }
    let message = format_args!(
        "a job with other parameters, seeds, weights or buffers was made of this upload, and an upload is one job's; \
         make another upload, or put the mesh where mesh_url may name it: {}",
        job.id
    );
    Err(Error::new(Kind::Conflict, message).into())
}

/// Whether a job is what a request wants. A number that a store kept may differ from the request's in its last digit.
fn is_same(job: &Spec, wanted: &Spec) -> bool {
    let compared = |spec: &Spec| {
        let mut spec = Spec { trace_parent: None, ..spec.clone() };
        if let Some(parts) = spec.referred.as_mut().and_then(|referred| referred.parts.as_mut()) {
            parts.folder.clear();
        }
        spec
    };
    let (job, wanted) = (compared(job), compared(wanted));
    let as_kept = serde_json::to_vec(&wanted).and_then(|json| serde_json::from_slice::<Spec>(&json));
    job == wanted || as_kept.is_ok_and(|wanted| job == wanted)
}

/// The job after it ended, or after a while; as it was accepted when the store cannot be read now.
async fn wait_for_end(shared: &Shared, job: Job, wait: Duration) -> Job {
    let Ok(Some(mut pulses)) = shared.store.watch(job.id).await else {
        return job;
    };
    tokio::select! {
        _ = pulses.wait_for(|pulse| pulse.ended) => {}
        () = tokio::time::sleep(wait) => {}
        () = shared.stop.cancelled() => {}
    }
    shared.store.get(job.id).await.ok().flatten().unwrap_or(job)
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;
    use crate::service::budget::Budget;
    use crate::service::files::{Files, SEEDS};
    use crate::service::job_blobs;
    use crate::service::settings::TrafficSettings;
    use crate::service::store::memory::MemoryStore;
    use crate::service::store::tests::{RULES, reserve};
    use crate::service::store::{JobId, LOCAL_TENANT, Queue as _};

    const MESH: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nf 1 2 3\nf 2 3 4\n";

    /// Receives the request for the job of an upload by URL, with seeds if any.
    async fn receive(files: &Arc<Files>, store: &MemoryStore, id: JobId, more: &str, seeds: &str) -> Upload {
        try_receive(files, store, id, more, seeds).await.expect("in order")
    }

    async fn try_receive(
        files: &Arc<Files>,
        store: &MemoryStore,
        id: JobId,
        more: &str,
        seeds: &str,
    ) -> Result<Upload, Error> {
        let mut request = Request::post(format!("/v1/jobs?upload={id}&clusters=2{more}"));
        let body = match seeds {
            "" => String::new(),
            seeds => {
                request = request.header(header::CONTENT_TYPE, "multipart/form-data; boundary=x");
                let head = "Content-Disposition: form-data; name=\"seeds\"; filename=\"s.json\"";
                format!("--x\r\n{head}\r\n\r\n{seeds}\r\n--x--\r\n")
            }
        };
        let request = request.body(Body::from(body)).expect("a request");
        let rules = Rules::new(1 << 20, &TrafficSettings::default(), Arc::new(Budget::new(1 << 30)));
        upload::receive(request, files, store, LOCAL_TENANT, false, rules).await
    }

    async fn create(store: &MemoryStore, upload: &Upload) -> Job {
        let (id, spec) = (upload.folder.id(), upload.spec.clone());
        match store.create(NewJob { id, spec, idempotency: None, upload: Vec::new() }).await.expect("created") {
            Created::New(job) | Created::Known(job) => job,
        }
    }

    #[tokio::test]
    async fn other_seeds_or_another_format_are_another_request() {
        let folder = tempfile::tempdir().expect("a folder");
        let (files, store) = (Files::with_urls(folder.path()), MemoryStore::new(RULES).expect("a store"));
        for first in ["[0, 1]", ""] {
            let id = reserve(&store, MESH.len() as u64).await;
            files.put_by_url(id, MESH).await;
            let upload = receive(&files, &store, id, "", first).await;
            assert_eq!(upload.spec.file_name.as_deref(), Some("horse.obj"));
            let job = create(&store, &upload).await;
            upload.folder.keep();
            for (more, seeds, expected) in [
                ("", "[0, 1]", !first.is_empty()),
                ("", "[1, 0]", false),
                ("", "", first.is_empty()),
                ("&format=ply", first, false),
            ] {
                let again = receive(&files, &store, id, more, seeds).await;
                assert!(again.earlier.is_some());
                assert_eq!(is_same(&job.spec, &again.spec), expected, "{first:?}, then {more:?} {seeds:?}");
            }
        }
    }

    #[tokio::test]
    async fn two_services_that_make_a_job_of_one_upload_overwrite_no_seeds() {
        let folder = tempfile::tempdir().expect("a folder");
        let (one, other) = (Files::with_urls(folder.path()), Files::with_urls(folder.path()));
        let store = MemoryStore::new(RULES).expect("a store");
        let id = reserve(&store, MESH.len() as u64).await;
        one.put_by_url(id, MESH).await;
        let first = receive(&one, &store, id, "", "[0, 1]").await;
        let second = receive(&other, &store, id, "", "[1, 0]").await;
        assert!(!is_same(&first.spec, &second.spec));
        let job = create(&store, &first).await;
        first.folder.keep();
        let seeds = async || {
            let blob = job_blobs::upload(&one, &store, &job, SEEDS, None).await?;
            Ok::<_, Error>(blob.bytes().await?.to_vec())
        };
        assert_eq!(seeds().await.expect("there"), b"[0, 1]");
        let refused = folder.path().join(format!("uploads/{id}/{}", second.folder.parts().expect("a folder")));
        assert!(refused.is_dir());
        drop(second);
        while refused.exists() {
            tokio::task::yield_now().await;
        }
        assert_eq!(seeds().await.expect("still there"), b"[0, 1]");
    }

    #[tokio::test]
    async fn an_upload_that_is_larger_than_reserved_is_refused_and_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let (files, store) = (Files::with_urls(folder.path()), MemoryStore::new(RULES).expect("a store"));
        let id = reserve(&store, MESH.len() as u64).await;
        for (mesh, kind, is_kept) in [
            (&MESH[1..], Kind::Conflict, true),
            (&[MESH, b"\n"].concat(), Kind::TooLarge, false),
            // more than any upload may have
            (&vec![b' '; 2 << 20], Kind::TooLarge, false),
        ] {
            files.put_by_url(id, mesh).await;
            let error = try_receive(&files, &store, id, "", "").await.expect_err("another size");
            assert_eq!(error.kind, kind);
            assert!(error.message.contains("was reserved for") && error.message.ends_with(&mesh.len().to_string()));
            assert_eq!(folder.path().join(format!("uploads/{id}/mesh-by-url")).exists(), is_kept, "{error}");
        }
        files.put_by_url(id, MESH).await;
        try_receive(&files, &store, id, "", "").await.expect("as reserved");
    }
}
