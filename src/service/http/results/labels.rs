//! Stored labels in a form that is made of them.

use std::io::{self, Read, Write};
use std::sync::Arc;

use axum::response::Response;
use tesserae_mesh::artifacts::{Content, Form, LABELS_NPY, Labels};
use tesserae_mesh::device::FREE;
use tesserae_mesh::error::{Error, Kind, Result};

use super::checked;
use super::encoded::{self, encoded};
use crate::files::Files;
use crate::http::state::Shared;
use crate::store::{Job, JobId, Summary};

/// Faces up to which labels are encoded without waiting for a turn.
const SMALL: u64 = 1 << 16;

pub(crate) async fn of_job(shared: &Shared, job: &Job, summary: &Summary, form: &'static Form) -> Result<Response> {
    let labels = checked::open(shared, job, LABELS_NPY.file).await?;
    let (head, faces) = (labels.length().saturating_sub(4 * summary.faces), summary.faces);
    let labels = labels.into_reader();
    made(shared, job, summary, LABELS_NPY.file, form, move || labels.read(|labels| read(labels, head, faces))).await
}

/// Labels that `read` reads from a blob, on a thread that may block, in a form that is made of them.
pub(super) async fn made(
    shared: &Shared,
    job: &Job,
    summary: &Summary,
    blob: &'static str,
    form: &'static Form,
    read: impl FnOnce() -> Result<Vec<u32>> + Send + 'static,
) -> Result<Response> {
    let (shape, are_points) = (summary.shape(), job.spec.format.is_of_points());
    let (job, clusters, files) = (job.id, summary.clusters, Arc::clone(&shared.files));
    let turn = if summary.faces > SMALL { Some(encoded::turn(shared).await?) } else { None };
    let write = move |out: &mut dyn Write| {
        let labels = read()?;
        check(&labels, are_points, clusters, &files, job, blob)?;
        let shape = Some(&shape[..]).filter(|shape| !shape.is_empty());
        let content = Content { labels: Some(Labels::new(clusters, &labels)), shape, ..Content::default() };
        (form.encode)(&content)?(out).map_err(encoded::cannot)
    };
    Ok(encoded(shared, turn, form.media_type, write).await?.0)
}

/// Refuses labels that are no clusters.
pub(super) fn check(
    labels: &[u32],
    are_points: bool,
    clusters: u64,
    files: &Files,
    job: JobId,
    blob: &str,
) -> Result<()> {
    // a mask leaves points out
    let is_free = |label| are_points && label == FREE;
    match labels.iter().find(|&&label| u64::from(label) >= clusters && !is_free(label)) {
        Some(label) => Err(files.damaged(job, blob, format_args!("a label is {label}, of {clusters} clusters"))),
        None => Ok(()),
    }
}

/// The labels of the faces, behind so many bytes.
pub(super) fn read(rows: &mut impl Read, head: u64, faces: u64) -> Result<Vec<u32>> {
    let mut bytes = vec![0; 4 * faces as usize];
    io::copy(&mut rows.take(head), &mut io::sink())
        .and_then(|_| rows.read_exact(&mut bytes))
        .map_err(|error| Error::new(Kind::Internal, format_args!("the labels cannot be read: {error}")))?;
    Ok(bytes.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect())
}
