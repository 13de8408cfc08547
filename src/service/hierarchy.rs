//! The hierarchy of a job: the tree in its forms, and labels cut from it.
//!
//! Everything comes from the stored hierarchy, without clustering again.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::io::Write;

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, HeaderValue, Uri};
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;

use super::access::Caller;
use super::encoded::{self, encoded};
use super::files;
use super::jobs::{find, tell_expiry};
use super::openapi::{Binary, Problematic};
use super::problem::Answer;
use super::results::{attachment, stored as stored_blob, succeeded};
use super::server::{App, Shared};
use super::store::Job;
use super::{blobs, negotiate, query};
use crate::error::{Error, Kind, Result};
use crate::output::{LabelFormat, write_cut};
use crate::tree::json::{Hierarchy, Limits};
use crate::tree::stored::{self, Input, Stored};

/// The query of the hierarchy.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct HierarchyQuery {
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
/// As JSON, as scipy's linkage matrix (`application/x-npy`: float64, a row a merge, for nested trees with one root: other
/// trees are 409), or as the file that `tesserae cut` reads (`application/octet-stream`); the format is chosen by
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
pub(super) async fn hierarchy(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = find(&shared, &caller, &id).await?;
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
        Form::Stored => stored_blob(&shared, &job, files::HIERARCHY, None, "application/octet-stream").await?,
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

/// The labels at any number of clusters, with headers that say what they are.
pub(super) async fn cut(shared: &Shared, job: &Job, clusters: u64, format: LabelFormat) -> Result<Response> {
    let turn = encoded::turn(shared).await?;
    let (file, length) = open(shared, job).await?;
    let write = move |out: &mut dyn Write| {
        let (_, cut) = stored::cut(file, length, u64::MAX, clusters).map_err(|error| match error.kind {
            // the number is sound, this hierarchy has no such state
            Kind::InvalidParameter => Error::new(Kind::Conflict, error.message),
            _ => Error::new(Kind::Internal, error.message),
        })?;
        write_cut(out, format, &cut).map_err(encoded::cannot)?;
        Ok((cut.kind(), cut.energy))
    };
    let (mut response, (kind, energy)) = encoded(shared, Some(turn), format.media_type(), write).await?;
    let headers = response.headers_mut();
    headers.insert("tesserae-cut", HeaderValue::from_static(kind));
    if let Ok(value) = HeaderValue::try_from(format!("{energy:e}")) {
        headers.insert("tesserae-energy", value);
    }
    Ok(response)
}

/// A stored hierarchy and its length.
async fn open(shared: &Shared, job: &Job) -> Result<(Box<dyn Input + Send>, u64)> {
    let blob = blobs::result(&shared.files, shared.store.as_ref(), job, files::HIERARCHY, None).await?;
    let length = blob.length();
    Ok((blob.into_reader(), length))
}

/// What `write` makes of a hierarchy, as a response that streams it.
async fn written(
    shared: &Shared,
    job: &Job,
    media_type: &'static str,
    write: impl FnOnce(&mut dyn Write, &Stored) -> Result<std::io::Result<()>> + Send + 'static,
) -> Result<Response> {
    let turn = encoded::turn(shared).await?;
    let (stored, length) = open(shared, job).await?;
    let write = move |out: &mut dyn Write| {
        // this service wrote it
        let tree = Stored::read(stored, length, u64::MAX).map_err(|error| Error::new(Kind::Internal, error.message))?;
        write(out, &tree)?.map_err(encoded::cannot)
    };
    Ok(encoded(shared, Some(turn), media_type, write).await?.0)
}
