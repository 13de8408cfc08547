//! The labels of a job, also those of an iteration and those cut from its hierarchy.

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, Uri};
use serde::Deserialize;
use tesserae_mesh::artifacts::{CutKind, HIERARCHY, LABELS, LABELS_BIN, LABELS_NPY, Need};
use tesserae_mesh::error::{Error, Kind};
use utoipa::IntoParams;

use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problematic};
use crate::guard::query;
use crate::http::conditional::Content;
use crate::http::negotiate;
use crate::http::results::stored::{Of, attachment, check_clusters, stored, succeeded};
use crate::http::results::{hierarchy, labels, snapshots};
use crate::http::state::App;

/// The query of the labels.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct LabelsQuery {
    /// Cut a hierarchy at this number of clusters; 409 for a flat clustering, and outside what the hierarchy has
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// The labels after this iteration of a flat clustering, where `snapshots` keeps them: `snapshots` of the
    /// report lists them; 404 for others
    #[param(minimum = 0)]
    iteration: Option<u32>,
    /// The format, `json`, `npy`, `bin`, `txt` or `csv`; by `Accept` when left out
    format: Option<String>,
}

/// Get the labels
///
/// One cluster number a face, in upload order; the format is chosen by `format` or `Accept`. `clusters` cuts a
/// hierarchy, and headers and JSON then say what kind of cut it is and what its energy. 409 before the job has
/// succeeded, and for a whole hierarchy without `clusters`.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/labels", tag = "results", operation_id = "getLabels",
    params(LabelsQuery),
    responses(
        (status = 200, description = "The labels", headers(
            ("Tesserae-Cut" = CutKind, description = "Of labels cut from a hierarchy: what kind of cut it is"),
            ("Tesserae-Energy" = f64, description = "Of labels cut from a hierarchy: their energy, source units"),
        )),
        (status = 422, response = Problematic),
    ),
)]
pub(crate) async fn labels(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = shared.job(&caller, &id).await?;
    let LabelsQuery { clusters, iteration, format } = query::read(&uri)?;
    let summary = succeeded(&job)?;
    let parameters = &job.spec.parameters;
    let is_hierarchical = HIERARCHY.is_made(parameters);
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
    check_clusters(&job, &summary, clusters)?;
    if LABELS.lacks(parameters) == Some(Need::Faces) {
        let message = "this job divided the faces of the mesh before it clustered them (subdivide): there are no \
                       labels of its faces, only the named outputs";
        return Err(Error::new(Kind::Conflict, message).into());
    }
    let form = negotiate::form(&headers, format.as_deref(), &LABELS)?;
    let mut response = match (clusters, iteration, form.file) {
        (Some(clusters), ..) => hierarchy::cut(&shared, &job, &summary, clusters, form).await?,
        (None, Some(iteration), _) => snapshots::labels(&shared, &job, &summary, iteration, form).await?,
        (None, None, file) if file == LABELS_NPY.file => {
            stored(&shared, &job, Of::Result, file, 0, form.media_type).await?
        }
        (None, None, file) if file == LABELS_BIN.file => {
            // the raw numbers are what follows the header of the .npy file
            let bytes = summary.blobs.get(LABELS_NPY.file).map_or(0, |contents| contents.bytes);
            let head = bytes.saturating_sub(4 * summary.faces);
            stored(&shared, &job, Of::Result, LABELS_NPY.file, head, form.media_type).await?
        }
        (None, None, _) => labels::of_job(&shared, &job, &summary, form).await?,
    };
    let name = iteration.map_or_else(|| "labels".to_owned(), |iteration| format!("labels.iteration-{iteration}"));
    if let Some(digest) = summary.labels_sha256.filter(|_| clusters.is_none() && iteration.is_none()) {
        response.extensions_mut().insert(Content(digest));
    }
    attachment(&mut response, &job, &format!("{name}.{}", form.extension()));
    Ok(response)
}
