//! The hierarchy of a job in its forms.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, Uri};
use serde::Deserialize;
use utoipa::IntoParams;

use super::binary::Binary;
use super::view::tell_expiry;
use crate::error::{Error, Kind};
use crate::hierarchy::json::{Hierarchy, Limits};
use crate::service::access::Caller;
use crate::service::problem::{Answer, Problematic};
use crate::service::results::hierarchy::written;
use crate::service::results::stored::{attachment, stored, succeeded};
use crate::service::state::App;
use crate::service::{files, negotiate, query};

/// The query of the hierarchy.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::service) struct HierarchyQuery {
    /// JSON: leave out what comes after fewer clusters than this are left
    #[param(minimum = 0)]
    min_clusters: Option<u64>,
    /// JSON: leave out what comes before as few clusters as this are left
    #[param(minimum = 0)]
    max_clusters: Option<u64>,
}

/// Forms of a hierarchy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    /// [`Hierarchy`].
    Json,
    /// scipy's linkage matrix.
    Linkage,
    /// The stored form, for `tesserae cut`.
    Stored,
}

impl Form {
    const ALL: [(Form, &'static str); 3] = [
        (Form::Json, "application/json"),
        (Form::Linkage, "application/x-npy"),
        (Form::Stored, "application/octet-stream"),
    ];
}

/// Get the hierarchy
///
/// As JSON, as scipy's linkage matrix (`application/x-npy`: float64, a row a merge, for nested trees with one root:
/// other trees are 409), or as the file that `tesserae cut` reads (`application/octet-stream`); the format is chosen by
/// `Accept`. 404 for jobs of flat algorithms, 409 before the job has succeeded.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/hierarchy", tag = "results", operation_id = "getHierarchy",
    params(("id" = String, Path, format = "uuid", description = "Id of the job"), HierarchyQuery),
    responses(
        (status = 200, description = "The hierarchy", content(
            (Hierarchy = "application/json"),
            (inline(Binary) = "application/x-npy"),
            (inline(Binary) = "application/octet-stream"),
        )),
        (status = 404, response = Problematic),
        (status = 406, response = Problematic),
        (status = 409, response = Problematic),
        (status = 422, response = Problematic),
        (status = 500, response = Problematic),
    ),
)]
pub(in crate::service) async fn hierarchy(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = shared.job(&caller, &id).await?;
    let algorithm = job.spec.parameters.algorithm;
    if !algorithm.is_hierarchical() {
        let message =
            format!("the job has no hierarchy, because its algorithm makes a flat clustering: {}", algorithm.name());
        return Err(Error::new(Kind::NotFound, message).into());
    }
    let HierarchyQuery { min_clusters, max_clusters } = query::read(&uri)?;
    let limits = Limits { min_clusters, max_clusters };
    limits.check()?;
    succeeded(&job)?;
    let form = negotiate::choose(&headers, "hierarchies", &Form::ALL)?;
    if limits.are_given() && form != Form::Json {
        return Err(Error::parameter("min_clusters and max_clusters go with application/json only").into());
    }
    let mut response = match form {
        Form::Json => {
            written(&shared, &job, "application/json", move |out, tree| Ok(tree.write_json(out, limits))).await?
        }
        Form::Linkage => {
            written(&shared, &job, "application/x-npy", |out, tree| Ok(tree.linkage()?.write_npy(out))).await?
        }
        Form::Stored => stored(&shared, &job, files::HIERARCHY, None, "application/octet-stream").await?,
    };
    let name = match form {
        Form::Json => "hierarchy.json",
        Form::Linkage => "linkage.npy",
        Form::Stored => "hierarchy.tsr",
    };
    attachment(&mut response, &job, name);
    tell_expiry(&mut response, &shared, &job);
    Ok(response)
}
