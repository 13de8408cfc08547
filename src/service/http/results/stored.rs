//! The stored blobs of a result, and those of an upload, as responses.

use std::ops::Range;
use std::sync::Arc;

use axum::body::Body;
use axum::http::header;
use axum::response::Response;
use futures_util::future::BoxFuture;
use object_store::GetRange;
use parking_lot::Mutex;
use tesserae_mesh::artifacts::{HIERARCHY, LABELS, Need};
use tesserae_mesh::error::{Error, Kind, Result};

use super::checked;
use super::encoded::streamed;
use crate::files::job_blobs;
use crate::http::conditional::Opens;
use crate::http::state::Shared;
use crate::store::{Job, State, Summary};

/// What a job gave; an error that says why there is nothing yet, or never will be.
pub(crate) fn succeeded(job: &Job) -> Result<Summary> {
    let conflict = |message: String| Err(Error::new(Kind::Conflict, message));
    match (job.state, &job.summary) {
        (State::Succeeded, Some(summary)) => Ok(summary.clone()),
        (State::Failed, _) => conflict(format!(
            "the job failed and has no result: {}",
            job.problem.as_ref().map_or("", |problem| &problem.message)
        )),
        (State::Cancelled, _) => Err(Error::new(Kind::Cancelled, "the job was cancelled and has no result")),
        (State::Queued | State::Running | State::Succeeded, _) => conflict(format!(
            "the job has no result yet; follow its events, or ask again later: it is {}",
            job.state.name()
        )),
    }
}

/// Refuses a number of clusters for a flat job, and none for a whole hierarchy.
pub(crate) fn check_clusters(job: &Job, summary: &Summary, clusters: Option<u64>) -> Result<()> {
    let parameters = &job.spec.parameters;
    match clusters {
        Some(clusters) if !HIERARCHY.is_made(parameters) => Err(Error::new(
            Kind::Conflict,
            format_args!(
                "this job made a flat clustering of {} clusters, which cannot be cut at another number; leave \
                 clusters out, not {clusters}",
                summary.clusters
            ),
        )),
        None if LABELS.lacks(parameters) == Some(Need::Labels) => Err(Error::new(
            Kind::Conflict,
            format_args!(
                "this job made a whole hierarchy, which has labels at every number of clusters: give clusters, from {} \
                 to {}",
                summary.clusters, summary.faces
            ),
        )),
        _ => Ok(()),
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Of {
    Upload,
    Result,
}

/// A blob of a job from one of its bytes on, as a response that opens it once the client is known to need it.
pub(crate) async fn stored(
    shared: &Arc<Shared>,
    job: &Job,
    of: Of,
    name: &str,
    from: u64,
    media_type: &'static str,
) -> Result<Response> {
    let (whole, upload) = match of {
        Of::Upload => {
            let blob = job_blobs::upload(&shared.files, shared.store.as_ref(), job, name, None).await?;
            (blob.length(), Some(blob))
        }
        Of::Result => (checked::expected(job, name)?.bytes, None),
    };
    let upload = Mutex::new(upload);
    let length = whole.saturating_sub(from);
    let (shared, job, name) = (Arc::clone(shared), job.clone(), name.to_owned());
    let open = move |range: Option<Range<u64>>| -> BoxFuture<'static, Result<Body>> {
        let (shared, job, name) = (Arc::clone(&shared), job.clone(), name.clone());
        let range = range.filter(|range| *range != (0..length));
        let range = range.map(|range| GetRange::Bounded(from + range.start..from + range.end));
        let opened = upload.lock().take().filter(|_| range.is_none());
        Box::pin(async move {
            if let Some(upload) = opened {
                return Ok(upload.into_body());
            }
            let blob = match (of, range) {
                (Of::Upload, range) => {
                    job_blobs::upload(&shared.files, shared.store.as_ref(), &job, &name, range).await
                }
                (Of::Result, None) => checked::whole(&shared, &job, &name, from).await,
                (Of::Result, Some(range)) => checked::part(&shared, &job, &name, range).await,
            };
            Ok(blob?.into_body())
        })
    };
    let mut response = streamed(length, Body::empty(), media_type);
    response.extensions_mut().insert(Opens(Arc::new(open)));
    Ok(response)
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
