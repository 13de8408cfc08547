//! The labels of iterations that a job kept: one file, a row an iteration, and the list of those iterations beside it.

use std::io::{Read, Write};

use axum::response::Response;
use object_store::GetRange;

use super::encoded::{self, encoded};
use crate::artifacts::{Content, Form, Labels, SNAPSHOTS_JSON, SNAPSHOTS_NPY};
use crate::error::{Error, Kind, Result};
use crate::service::blobs::Blob;
use crate::service::job_blobs;
use crate::service::state::Shared;
use crate::service::store::{Job, Summary};

/// Faces up to which labels are encoded without waiting for a turn.
const SMALL: u64 = 1 << 16;

/// The labels after an iteration of a flat clustering.
pub(in crate::service) async fn labels(
    shared: &Shared,
    job: &Job,
    summary: &Summary,
    iteration: u32,
    form: &'static Form,
) -> Result<Response> {
    let kept = list(shared, job).await?;
    let Some(row) = kept.iter().position(|&kept| kept == iteration) else {
        return Err(none_of(&kept, iteration));
    };
    let from_end = 4 * summary.faces * (kept.len() - row) as u64;
    let range = Some(GetRange::Suffix(from_end));
    let rows = job_blobs::result(&shared.files, shared.store.as_ref(), job, SNAPSHOTS_NPY.file, range).await?;
    labels_of(shared, rows, summary, form).await
}

/// Labels from where they begin in a blob, in a form that is made of them.
pub(in crate::service) async fn labels_of(
    shared: &Shared,
    rows: Blob,
    summary: &Summary,
    form: &'static Form,
) -> Result<Response> {
    let (faces, clusters) = (summary.faces, summary.clusters);
    let turn = if faces > SMALL { Some(encoded::turn(shared).await?) } else { None };
    let rows = rows.into_reader();
    let write = move |out: &mut dyn Write| {
        let labels = read_labels(rows, faces)?;
        let content = Content { labels: Some(Labels::new(clusters, &labels)), ..Content::default() };
        (form.encode)(&content)?(out).map_err(encoded::cannot)
    };
    Ok(encoded(shared, turn, form.media_type, write).await?.0)
}

/// The iterations whose labels were kept.
async fn list(shared: &Shared, job: &Job) -> Result<Vec<u32>> {
    let json = match job_blobs::result(&shared.files, shared.store.as_ref(), job, SNAPSHOTS_JSON.file, None).await {
        Ok(list) => list.bytes().await?,
        Err(error) if error.kind == Kind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    serde_json::from_slice(&json)
        .map_err(|error| Error::new(Kind::Internal, format_args!("the list of snapshots is damaged: {error}")))
}

/// The error for an iteration that is not among those that were kept.
fn none_of(kept: &[u32], iteration: u32) -> Error {
    let list: Vec<String> = kept.iter().take(100).map(u32::to_string).collect();
    Error::new(
        Kind::NotFound,
        match list.is_empty() {
            true => format!(
                "this job kept the labels of no iteration: ask for them with the parameter snapshots; there are none \
                 of {iteration}"
            ),
            false => format!("this job kept the labels of iterations {}, not of {iteration}", list.join(", ")),
        },
    )
}

/// The labels of the faces, from where they begin.
pub(super) fn read_labels(mut rows: impl Read, faces: u64) -> Result<Vec<u32>> {
    let mut bytes = vec![0; 4 * faces as usize];
    rows.read_exact(&mut bytes)
        .map_err(|error| Error::new(Kind::Internal, format_args!("the snapshots end early: {error}")))?;
    Ok(bytes.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect())
}
