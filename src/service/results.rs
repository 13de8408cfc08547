//! The results of a job: labels and report. What a hierarchy gives is in `hierarchy`.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::ops::Range;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, Uri, header};
use axum::response::{IntoResponse, Response};
use futures_util::future::BoxFuture;
use object_store::GetRange;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::access::Caller;
use super::conditional::{Content, Parts};
use super::files;
use super::jobs::{find, tell_expiry};
use super::problem::Answer;
use super::server::{App, Shared};
use super::store::{Job, State, Summary};
use super::{blobs, hierarchy, negotiate, openapi::Problematic, query, snapshots};
use crate::error::{Error, Kind, Result};
use crate::output::LabelFormat;

/// Labels as JSON; the two other formats hold the same numbers.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Labels {
    /// Number of clusters.
    clusters: u64,
    /// Of labels cut from a hierarchy: `exact` for a state that the run had, `merged` for the last one with more clusters
    /// and the next round's cheapest merges on top.
    #[serde(skip_serializing_if = "Option::is_none")]
    cut: Option<CutKind>,
    /// Of labels cut from a hierarchy: their energy, source units. Null when it overflows.
    #[serde(skip_serializing_if = "Option::is_none")]
    energy: Option<f64>,
    /// The cluster of each face, in upload order: 0 … clusters − 1.
    labels: Vec<u32>,
}

/// What a cut of a hierarchy is
#[derive(Debug, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[expect(dead_code, reason = "describes labels for openapi.yaml; they are written as they come")]
pub(super) enum CutKind {
    /// A state that the run had.
    Exact,
    /// The last state with more clusters, and the next round's cheapest merges.
    Merged,
}

/// The query of the labels.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct LabelsQuery {
    /// Cut a hierarchy at this number of clusters; 409 for a flat clustering, and outside what the hierarchy has
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// The labels after this iteration of a flat clustering, where `snapshots` asked for them: `snapshots` of the report lists
    /// them; 404 for others
    #[param(minimum = 0)]
    iteration: Option<u32>,
}

/// Get the labels
///
/// One cluster number a face, in upload order; the format is chosen by `Accept`. `clusters` cuts a hierarchy, and headers
/// and JSON then say what kind of cut it is and what its energy. 409 before the job has succeeded, and for a whole
/// hierarchy without `clusters`.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/labels", tag = "results", operation_id = "getLabels",
    params(("id" = String, Path, format = "uuid", description = "Id of the job"), LabelsQuery),
    responses(
        (status = 200, description = "The labels", content(
            (Labels = "application/json"),
            (inline(super::openapi::Binary) = "application/x-npy"),
            (inline(super::openapi::Binary) = "application/octet-stream"),
        ), headers(
            ("Tesserae-Cut" = CutKind, description = "Of labels cut from a hierarchy: what kind of cut it is"),
            ("Tesserae-Energy" = f64, description = "Of labels cut from a hierarchy: their energy, source units"),
        )),
        (status = 404, response = Problematic),
        (status = 406, response = Problematic),
        (status = 409, response = Problematic),
        (status = 422, response = Problematic),
        (status = 500, response = Problematic),
    ),
)]
pub(super) async fn labels(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = find(&shared, &caller, &id).await?;
    let LabelsQuery { clusters, iteration } = query::read(&uri)?;
    let summary = succeeded(&job)?;
    let is_hierarchical = job.spec.parameters.algorithm.is_hierarchical();
    if let Some(clusters) = clusters.filter(|_| !is_hierarchical) {
        return Err(Error::new(
            Kind::Conflict,
            format_args!(
                "this job made a flat clustering of {} clusters, which cannot be cut at another number; leave \
                 clusters out, not {clusters}",
                summary.clusters
            ),
        )
        .into());
    }
    if let Some(iteration) = iteration.filter(|_| is_hierarchical) {
        return Err(Error::new(
            Kind::Conflict,
            format_args!(
                "this job made a hierarchy, which keeps the labels of no iteration: give clusters instead of iteration, \
                 {iteration}"
            ),
        )
        .into());
    }
    if clusters.is_none() && !summary.has_labels {
        return Err(Error::new(
            Kind::Conflict,
            format_args!(
                "this job made a whole hierarchy, which has labels at every number of clusters: give clusters, from {} \
                 to {}",
                summary.clusters, summary.faces
            ),
        )
        .into());
    }
    let format = negotiate::label_format(&headers)?;
    // The raw numbers are what follows the header of the .npy file.
    let mut response = match (clusters, format) {
        (Some(clusters), format) => hierarchy::cut(&shared, &job, clusters, format).await?,
        (None, format) if iteration.is_some() => {
            snapshots::labels(&shared, &job, &summary, iteration.unwrap_or_default(), format).await?
        }
        (None, LabelFormat::Json) => {
            let numbers = Some(GetRange::Suffix(4 * summary.faces));
            let numbers = blobs::result(&shared.files, shared.store.as_ref(), &job, files::LABELS_NPY, numbers).await?;
            snapshots::labels_of(&shared, numbers, &summary, format).await?
        }
        (None, LabelFormat::Npy) => stored(&shared, &job, files::LABELS_NPY, None, format.media_type()).await?,
        (None, LabelFormat::Raw) => {
            let numbers = Some(GetRange::Suffix(4 * summary.faces));
            stored(&shared, &job, files::LABELS_NPY, numbers, format.media_type()).await?
        }
    };
    let name = iteration.map_or_else(|| "labels".to_owned(), |iteration| format!("labels.iteration-{iteration}"));
    if let Some(digest) = summary.labels_sha256.filter(|_| clusters.is_none() && iteration.is_none()) {
        response.extensions_mut().insert(Content(digest));
    }
    attachment(&mut response, &job, &format!("{name}.{}", format.extension()));
    tell_expiry(&mut response, &shared, &job);
    Ok(response)
}

/// Get the report
///
/// What was read, the energies, every iteration, the timings. 409 before the job has succeeded.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/report", tag = "results", operation_id = "getReport",
    params(("id" = String, Path, format = "uuid", description = "Id of the job")),
    responses(
        (status = 200, description = "The report", body = crate::report::Report),
        (status = 404, response = Problematic),
        (status = 409, response = Problematic),
        (status = 500, response = Problematic),
    ),
)]
pub(super) async fn report(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer {
    let job = find(&shared, &caller, &id).await?;
    succeeded(&job)?;
    let mut response = stored(&shared, &job, files::REPORT, None, "application/json").await?;
    tell_expiry(&mut response, &shared, &job);
    Ok(response)
}

/// What a job gave; an error that says why there is nothing yet, or never will be.
pub(super) fn succeeded(job: &Job) -> Result<Summary> {
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

/// A result, or a range of it, as a response that streams it.
pub(super) async fn stored(
    shared: &Shared,
    job: &Job,
    name: &str,
    range: Option<GetRange>,
    media_type: &'static str,
) -> Result<Response> {
    let (files, store) = (Arc::clone(&shared.files), Arc::clone(&shared.store));
    let blob = blobs::result(&files, store.as_ref(), job, name, range).await?;
    let (job, name, start) = (job.clone(), name.to_owned(), blob.start());
    let part = move |range: Range<u64>| -> BoxFuture<'static, Result<Body>> {
        let (files, store, job, name) = (Arc::clone(&files), Arc::clone(&store), job.clone(), name.clone());
        let range = GetRange::Bounded(start + range.start..start + range.end);
        Box::pin(async move { Ok(blobs::result(&files, store.as_ref(), &job, &name, Some(range)).await?.into_body()) })
    };
    let mut response = streamed(blob.length(), blob.into_body(), media_type);
    response.extensions_mut().insert(Parts(Arc::new(part)));
    Ok(response)
}

/// A body of known length as a response.
pub(super) fn streamed(length: u64, body: Body, media_type: &'static str) -> Response {
    ([(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_LENGTH, length.to_string())], body)
        .into_response()
}

/// Says under which name a result is best kept, and that there are others.
pub(super) fn attachment(response: &mut Response, job: &Job, name: &str) {
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
