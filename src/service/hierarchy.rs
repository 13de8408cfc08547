//! The hierarchy of a job: the tree in its forms, and labels cut from it.
//!
//! Everything comes from the stored hierarchy, without clustering again. A hierarchy is in memory only while it is cut or
//! written, and only so many are at a time: what is large goes to a file without a name first and from there to the
//! client, who may take as long as it likes.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::io::{BufWriter, Read, Seek, Write};

use axum::body::Body;
use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use tokio_util::io::ReaderStream;
use utoipa::IntoParams;

use super::access::Caller;
use super::files::{self, blocking};
use super::jobs::{find, tell_expiry};
use super::openapi::{Binary, Problematic};
use super::problem::Answer;
use super::results::{attachment, stored as stored_blob, streamed, succeeded};
use super::server::{App, Shared};
use super::store::Job;
use super::{blobs, negotiate, query};
use crate::error::{Error, Kind, Result};
use crate::output::{LabelFormat, write_cut};
use crate::tree::json::{Hierarchy, Limits};
use crate::tree::stored::{self, Stored};

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
    let turn = turn(shared).await?;
    let (file, length) = open(shared, job).await?;
    let (body, kind, energy) = blocking(move || {
        let _turn = turn;
        let (_, cut) = stored::cut(file, length, u64::MAX, clusters).map_err(|error| match error.kind {
            // the number is sound, this hierarchy has no such state
            Kind::InvalidParameter => Error::new(Kind::Conflict, error.message),
            _ => Error::new(Kind::Internal, error.message),
        })?;
        let mut body = Vec::new();
        write_cut(&mut body, format, &cut).map_err(|error| Error::io("labels cannot be written", error))?;
        Ok::<_, Error>((body, cut.kind(), cut.energy))
    })
    .await??;
    let mut response = ([(header::CONTENT_TYPE, format.media_type())], Body::from(body)).into_response();
    let headers = response.headers_mut();
    headers.insert("tesserae-cut", HeaderValue::from_static(kind));
    if let Ok(value) = HeaderValue::try_from(format!("{energy:e}")) {
        headers.insert("tesserae-energy", value);
    }
    Ok(response)
}

/// The right to have a hierarchy, or other labels than those that are files, in memory.
pub(super) async fn turn(shared: &Shared) -> Result<tokio::sync::OwnedSemaphorePermit> {
    let turn = shared.hierarchies.clone().acquire_owned().await;
    turn.map_err(|error| Error::new(Kind::Internal, format_args!("no hierarchy can be read: {error}")))
}

/// A stored hierarchy and its length.
async fn open(shared: &Shared, job: &Job) -> Result<(Box<dyn Read + Send>, u64)> {
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
    let turn = turn(shared).await?;
    let (stored, length) = open(shared, job).await?;
    let folder = shared.files.scratch();
    let (file, bytes) = blocking(move || {
        let _turn = turn;
        // this service wrote it
        let tree = Stored::read(stored, length, u64::MAX).map_err(|error| Error::new(Kind::Internal, error.message))?;
        let cannot = |error| Error::io("the hierarchy cannot be written", error);
        let mut out = BufWriter::with_capacity(1 << 18, tempfile::tempfile_in(folder).map_err(cannot)?);
        write(&mut out, &tree)?.map_err(cannot)?;
        let mut file = out.into_inner().map_err(|error| cannot(error.into_error()))?;
        let bytes = file.stream_position().map_err(cannot)?;
        file.rewind().map_err(cannot)?;
        Ok::<_, Error>((file, bytes))
    })
    .await??;
    let body = Body::from_stream(ReaderStream::new(tokio::fs::File::from_std(file)));
    Ok(streamed(bytes, body, media_type))
}
