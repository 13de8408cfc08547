//! The stored blobs of a result, and those of an upload, as responses.

use std::future::Future;
use std::ops::Range;
use std::sync::Arc;

use axum::body::Body;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use futures_util::future::BoxFuture;
use object_store::GetRange;
use tesserae_mesh::error::Result;

use super::{DoneJob, checked};
use crate::blobs::Blob;
use crate::files::job_blobs;
use crate::http::conditional::Opens;
use crate::http::state::Shared;
use crate::store::Job;

/// A blob of a result from one of its bytes on.
pub(crate) fn stored(done: &Arc<DoneJob>, name: &'static str, from: u64, media_type: &'static str) -> Result<Response> {
    let length = checked::expected(done, name)?.bytes.saturating_sub(from);
    let done = Arc::clone(done);
    Ok(opened_when_needed(length, media_type, move |range| {
        let done = Arc::clone(&done);
        async move {
            match range {
                None => checked::whole(&done, name, from).await,
                Some(Range { start, end }) => {
                    checked::part(&done, name, GetRange::Bounded(from + start..from + end)).await
                }
            }
        }
    }))
}

pub(crate) async fn of_upload(shared: &Arc<Shared>, job: &Job, name: String) -> Result<Response> {
    let length = job_blobs::upload(&shared.files, &shared.store, job, &name, None).await?.length();
    let of = Arc::new((Arc::clone(shared), job.clone(), name));
    Ok(opened_when_needed(length, "application/octet-stream", move |range| {
        let of = Arc::clone(&of);
        async move {
            let (shared, job, name) = &*of;
            job_blobs::upload(&shared.files, &shared.store, job, name, range.map(GetRange::Bounded)).await
        }
    }))
}

/// A response that opens its blob, or a part of it, once the client is known to need it.
fn opened_when_needed<F: Future<Output = Result<Blob>> + Send + 'static>(
    length: u64,
    media_type: &'static str,
    open: impl Fn(Option<Range<u64>>) -> F + Send + Sync + 'static,
) -> Response {
    let open = move |range: Option<Range<u64>>| -> BoxFuture<'static, Result<Body>> {
        let blob = open(range.filter(|range| *range != (0..length)));
        Box::pin(async { Ok(blob.await?.into_body()) })
    };
    let mut response = with_length(length, Body::empty(), media_type);
    response.extensions_mut().insert(Opens(Arc::new(open)));
    response
}

pub(super) fn with_length(length: u64, body: Body, media_type: &'static str) -> Response {
    let headers = [(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_LENGTH, length.to_string())];
    (headers, body).into_response()
}

/// Says under which name a result is best kept, and that there are others.
pub(crate) fn attachment(response: &mut Response, job: &Job, name: &str) {
    let headers = response.headers_mut();
    if let Ok(value) = format!("attachment; filename=\"{}-{name}\"", stem(job)).parse() {
        headers.insert(header::CONTENT_DISPOSITION, value);
    }
    headers.insert(header::VARY, header::HeaderValue::from_static("accept"));
}

/// What results are called after: the mesh file's name as far as it is harmless in a header, else the job.
fn stem(job: &Job) -> String {
    let name = job.spec.file_name.as_deref().unwrap_or_default();
    let name = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let stem: String =
        stem.chars().filter(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.')).take(100).collect();
    let stem = stem.trim_start_matches('.');
    if stem.is_empty() { job.id.to_string() } else { stem.to_owned() }
}
