//! What is made of a stored hierarchy, without clustering again: labels at a number of clusters, and other forms.

use std::io::Write;
use std::sync::Arc;

use axum::response::{IntoResponse as _, Response};
use tesserae_mesh::artifacts::{Content, Form, HIERARCHY_TSR, Labels};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::json::Limits;
use tesserae_mesh::hierarchy::stored::{self, Input, Stored};

use super::checked;
use super::encoded::{self, encoded};
use crate::files::Files;
use crate::http::state::Shared;
use crate::store::{Job, JobId, Summary};

/// The labels at any number of clusters, with headers that say what they are.
pub(crate) async fn cut(
    shared: &Shared,
    job: &Job,
    summary: &Summary,
    clusters: u64,
    form: &'static Form,
) -> Result<Response> {
    let shape = summary.shape();
    let turn = encoded::turn(shared).await?;
    let (file, length) = open(shared, job).await?;
    let (id, files) = (job.id, Arc::clone(&shared.files));
    let write = move |out: &mut dyn Write| {
        let (_, cut) = stored::cut(file, length, u64::MAX, clusters).map_err(|error| of_cut(&files, id, error))?;
        let shape = Some(&shape[..]).filter(|shape| !shape.is_empty());
        let content = Content { labels: Some(Labels::from(&cut)), shape, ..Content::default() };
        (form.encode)(&content)?(out).map_err(encoded::cannot)?;
        Ok((cut.kind(), cut.energy))
    };
    let (response, (kind, energy)) = encoded(shared, Some(turn), form.media_type, write).await?;
    Ok(([("tesserae-cut", kind.to_owned()), ("tesserae-energy", format!("{energy:e}"))], response).into_response())
}

/// The error of a number of clusters that a stored hierarchy cannot be cut at, for clients.
pub(super) fn of_cut(files: &Files, job: JobId, error: Error) -> Error {
    match error.kind {
        // the number is sound, this hierarchy has no such state
        Kind::InvalidParameter => Error::new(Kind::Conflict, error.message),
        _ => of_stored(files, job, error),
    }
}

/// The error of a stored hierarchy that cannot be read: this service wrote it.
fn of_stored(files: &Files, job: JobId, error: Error) -> Error {
    match error.kind {
        // what keeps it failed in the middle
        Kind::Io => Error::new(Kind::Unavailable, error.message),
        _ => files.damaged(job, HIERARCHY_TSR.file, error.message),
    }
}

async fn open(shared: &Shared, job: &Job) -> Result<(Box<dyn Input + Send>, u64)> {
    let blob = checked::open(shared, job, HIERARCHY_TSR.file).await?;
    let length = blob.length();
    Ok((blob.into_hierarchy(), length))
}

pub(crate) async fn made(shared: &Shared, job: &Job, form: &'static Form, limits: Limits) -> Result<Response> {
    let turn = encoded::turn(shared).await?;
    let (stored, length) = open(shared, job).await?;
    let (id, files) = (job.id, Arc::clone(&shared.files));
    let write = move |out: &mut dyn Write| {
        let tree = Stored::read(stored, length, u64::MAX).map_err(|error| of_stored(&files, id, error))?;
        let check = limits.clusters.map_or(Ok(()), |clusters| tree.tree.check_cut(clusters));
        check.map_err(|error| of_cut(&files, id, error))?;
        let content = Content { hierarchy: Some(&tree), limits, ..Content::default() };
        (form.encode)(&content)?(out).map_err(encoded::cannot)
    };
    Ok(encoded(shared, Some(turn), form.media_type, write).await?.0)
}
