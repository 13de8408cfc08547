//! The labels of iterations that a job kept: one file, a row an iteration, and the list of those iterations beside it.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use axum::body::Body;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use super::files::{self, blocking};
use super::hierarchy::turn;
use super::results::cannot_read;
use super::server::Shared;
use super::store::{Job, Summary};
use crate::error::{Error, Kind, Result};
use crate::output::{LabelFormat, write_labels};

/// The labels after an iteration of a flat clustering.
pub(super) async fn labels(
    shared: &Shared,
    job: &Job,
    summary: Summary,
    iteration: u32,
    format: LabelFormat,
) -> Result<Response> {
    let folder = shared.files.result(job.id);
    let turn = turn(shared).await?;
    let body = blocking(move || {
        let _turn = turn;
        let labels = read(&folder, summary.faces, iteration)?;
        let mut body = Vec::new();
        write_labels(&mut body, format, summary.clusters, &labels)
            .map_err(|error| Error::io("labels cannot be written", error))?;
        Ok::<_, Error>(body)
    })
    .await??;
    Ok(([(header::CONTENT_TYPE, format.media_type())], Body::from(body)).into_response())
}

/// The row of an iteration.
fn read(folder: &Path, faces: u64, iteration: u32) -> Result<Vec<u32>> {
    let kept: Vec<u32> = match std::fs::read(folder.join(files::SNAPSHOT_LIST)) {
        Ok(json) => serde_json::from_slice(&json)
            .map_err(|error| Error::new(Kind::Internal, format_args!("the list of snapshots is damaged: {error}")))?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound && folder.is_dir() => Vec::new(),
        Err(error) => return Err(cannot_read(error)),
    };
    let Some(row) = kept.iter().position(|&kept| kept == iteration) else {
        let list: Vec<String> = kept.iter().take(100).map(u32::to_string).collect();
        return Err(Error::new(
            Kind::NotFound,
            match list.is_empty() {
                true => format!(
                    "this job kept the labels of no iteration: ask for them with the parameter snapshots; there are none of \
                     {iteration}"
                ),
                false => format!("this job kept the labels of iterations {}, not of {iteration}", list.join(", ")),
            },
        ));
    };
    let mut file = File::open(folder.join(files::SNAPSHOTS)).map_err(cannot_read)?;
    let from_end = 4 * faces * (kept.len() - row) as u64;
    let length = file.metadata().map_err(cannot_read)?.len();
    let start = length.checked_sub(from_end).ok_or_else(|| Error::new(Kind::Internal, "the snapshots end early"))?;
    file.seek(SeekFrom::Start(start)).map_err(cannot_read)?;
    let mut bytes = vec![0; 4 * faces as usize];
    file.read_exact(&mut bytes).map_err(cannot_read)?;
    Ok(bytes.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect())
}
