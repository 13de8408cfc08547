//! Uploads by URL: the mesh goes to the bucket, not through the service.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::time::SystemTime;

use axum::Json;
use axum::extract::{Path, State as Extract};
use axum::http::{StatusCode, Uri};
use serde::{Deserialize, Serialize};
use tracing::Instrument as _;
use utoipa::ToSchema;

use crate::error::{Error, Kind};
use crate::service::access::Caller;
use crate::service::audit::{self, Action};
use crate::service::blobs::PutUrl;
use crate::service::problem::{Answer, Problematic};
use crate::service::query;
use crate::service::state::{App, Shared};
use crate::service::store::{JobId, RESERVED_FOR, no_such_upload};
use crate::service::timestamp::rfc3339;
use crate::service::upload::{kept_name, reservation};

/// What is to be uploaded.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    bytes: u64,
    file_name: Option<String>,
}

/// An upload by URL.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Upload)]
pub(in crate::service) struct UploadView {
    /// Its id, which `upload` of `POST /v1/jobs` takes.
    id: JobId,
    /// Takes the mesh: the body of a `PUT`, without a token.
    url: String,
    /// When the URL ends, or the temporary key that signed it may end. A `PUT` that has begun goes on.
    #[schema(format = DateTime)]
    url_expires_at: String,
    /// When the upload goes, unless a job was made of it.
    #[schema(format = DateTime)]
    expires_at: String,
}

/// Reserve an upload by URL
///
/// For meshes that are too large to go through the service: `PUT` the mesh to the URL, then `POST
/// /v1/jobs?upload={id}`. It is refused while waiting jobs and uploads without a job are together as many as jobs may
/// wait. 501 where the files of jobs do not lie in a bucket.
#[utoipa::path(
    post, path = "/v1/uploads", tag = "jobs", operation_id = "createUpload",
    params(
        ("bytes" = u64, Query, description = "Number of bytes of the mesh"),
        ("file_name" = Option<String>, Query, example = "horse.glb",
         description = "Name of the mesh file, which the job has then: 255 characters are kept. Its extension says \
                        the format where the request for the job does not"),
    ),
    responses(
        (status = 201, description = "The upload is expected", body = UploadView),
        (status = 413, response = Problematic),
        (status = 422, response = Problematic),
        (status = 501, response = Problematic),
    ),
)]
pub(in crate::service) async fn create(
    Extract(shared): App,
    caller: Caller,
    uri: Uri,
) -> Answer<(StatusCode, Json<UploadView>)> {
    if shared.stop.is_cancelled() {
        return Err(Shared::stopping().into());
    }
    let tenant = caller.tenant()?.clone();
    let Wanted { bytes, file_name } = query::read(&uri)?;
    let file_name = file_name.as_deref().map(kept_name);
    shared.files.check_urls()?;
    shared.settings.limits().check_bytes(bytes)?;
    let now = SystemTime::now();
    // on a task of its own, so that a client that hangs up now leaves no reservation that it does not know
    let reserving = async move { shared.admission.reserve(&shared.files, &tenant, bytes, file_name).await };
    let (id, PutUrl { url, valid }) = tokio::spawn(reserving.in_current_span())
        .await
        .map_err(|error| Error::new(Kind::Internal, format_args!("the upload was not reserved: {error}")))??;
    audit::record(Action::Reserved(bytes), &caller, id);
    let (url_expires_at, expires_at) = (rfc3339(now + valid), rfc3339(now + RESERVED_FOR));
    Ok((StatusCode::CREATED, Json(UploadView { id, url, url_expires_at, expires_at })))
}

/// Give an upload by URL up
///
/// It does not count any more, and what was stored is removed. 404 for an upload that is a job.
#[utoipa::path(
    delete, path = "/v1/uploads/{id}", tag = "jobs", operation_id = "deleteUpload",
    responses((status = 204, description = "It is gone"), (status = 501, response = Problematic)),
)]
pub(in crate::service) async fn remove(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
) -> Answer<StatusCode> {
    let tenant = caller.tenant()?;
    let id: JobId = id.parse()?;
    let _taken = shared.files.incoming_reserved(id)?;
    reservation(id, &shared.files, shared.store.as_ref(), &tenant.name).await?;
    if !shared.store.unreserve(id).await? {
        return Err(no_such_upload(id).into());
    }
    shared.files.remove_upload(id).await;
    audit::record(Action::Deleted, &caller, id);
    Ok(StatusCode::NO_CONTENT)
}
