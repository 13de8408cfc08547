//! The labels of a job, also those of an iteration and those cut from its hierarchy.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, Uri};
use object_store::GetRange;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::binary::Binary;
use super::view::tell_expiry;
use crate::error::{Error, Kind};
use crate::output::LabelFormat;
use crate::service::access::Caller;
use crate::service::conditional::Content;
use crate::service::problem::{Answer, Problematic};
use crate::service::results::stored::{attachment, stored, succeeded};
use crate::service::results::{hierarchy, snapshots};
use crate::service::state::App;
use crate::service::{blobs, files, negotiate, query};

/// Labels as JSON; the two other formats hold the same numbers.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::service) struct Labels {
    /// Number of clusters.
    clusters: u64,
    /// Of labels cut from a hierarchy: `exact` for a state that the run had, `merged` for the last one with more
    /// clusters and the next round's cheapest merges on top.
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
pub(in crate::service) enum CutKind {
    /// A state that the run had.
    Exact,
    /// The last state with more clusters, and the next round's cheapest merges.
    Merged,
}

/// The query of the labels.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::service) struct LabelsQuery {
    /// Cut a hierarchy at this number of clusters; 409 for a flat clustering, and outside what the hierarchy has
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// The labels after this iteration of a flat clustering, where `snapshots` keeps them: `snapshots` of the report
    /// lists them; 404 for others
    #[param(minimum = 0)]
    iteration: Option<u32>,
}

/// Get the labels
///
/// One cluster number a face, in upload order; the format is chosen by `Accept`. `clusters` cuts a hierarchy, and
/// headers and JSON then say what kind of cut it is and what its energy. 409 before the job has succeeded, and for a
/// whole hierarchy without `clusters`.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/labels", tag = "results", operation_id = "getLabels",
    params(("id" = String, Path, format = "uuid", description = "Id of the job"), LabelsQuery),
    responses(
        (status = 200, description = "The labels", content(
            (Labels = "application/json"),
            (inline(Binary) = "application/x-npy"),
            (inline(Binary) = "application/octet-stream"),
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
pub(in crate::service) async fn labels(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = shared.job(&caller, &id).await?;
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
                "this job made a hierarchy, which keeps the labels of no iteration: give clusters instead of \
                 iteration, {iteration}"
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
