//! The hierarchy of a job in its forms.

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, Uri};
use serde::Deserialize;
use tesserae_mesh::artifacts::{HIERARCHY, HIERARCHY_JSON};
use tesserae_mesh::error::{Error, Kind};
use tesserae_mesh::hierarchy::json::Limits;
use utoipa::IntoParams;

use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problematic};
use crate::guard::query;
use crate::http::negotiate;
use crate::http::results::hierarchy::made;
use crate::http::results::stored::{Of, attachment, stored, succeeded};
use crate::http::state::App;

/// The query of the hierarchy.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct HierarchyQuery {
    /// JSON: leave out what comes after fewer clusters than this are left
    #[param(minimum = 0)]
    min_clusters: Option<u64>,
    /// JSON: leave out what comes before as few clusters as this are left
    #[param(minimum = 0)]
    max_clusters: Option<u64>,
    /// JSON: add the clusters of this cut as nodes, in the order of their labels
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// The format, `json`, `npy` or `tsr`; by `Accept` when left out
    format: Option<String>,
}

/// Get the hierarchy
///
/// As JSON, as scipy's linkage matrix (`application/x-npy`: float64, a row a merge, for nested trees with one root:
/// other trees are 409), or as the file that `tesserae cut` reads (`application/octet-stream`); the format is chosen by
/// `format` or `Accept`. 404 for jobs of flat algorithms, 409 before the job has succeeded.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/hierarchy", tag = "results", operation_id = "getHierarchy",
    params(HierarchyQuery),
    responses(
        (status = 200, description = "The hierarchy"),
        (status = 422, response = Problematic),
    ),
)]
pub(crate) async fn hierarchy(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = shared.job(&caller, &id).await?;
    let parameters = &job.spec.parameters;
    if !HIERARCHY.is_made(parameters) {
        let algorithm = parameters.algorithm.name();
        let message = format!("the job has no hierarchy, because its algorithm makes a flat clustering: {algorithm}");
        return Err(Error::new(Kind::NotFound, message).into());
    }
    let HierarchyQuery { min_clusters, max_clusters, clusters, format } = query::read(&uri)?;
    let limits = Limits { min_clusters, max_clusters, clusters };
    limits.check()?;
    succeeded(&job)?;
    let form = negotiate::form(&headers, format.as_deref(), &HIERARCHY)?;
    if limits.are_given() && form.file != HIERARCHY_JSON.file {
        return Err(Error::parameter("clusters, min_clusters and max_clusters go with application/json only").into());
    }
    let mut response = match form.is_stored {
        true => stored(&shared, &job, Of::Result, form.file, 0, form.media_type).await?,
        false => made(&shared, &job, form, limits).await?,
    };
    attachment(&mut response, &job, form.file);
    Ok(response)
}
