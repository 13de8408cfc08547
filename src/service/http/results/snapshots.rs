//! The labels of iterations that a job kept: one file, a row an iteration, and the list of those iterations beside it.

use axum::response::Response;
use object_store::GetRange;
use tesserae_mesh::artifacts::{Form, SNAPSHOTS_JSON, SNAPSHOTS_NPY};
use tesserae_mesh::error::{Error, Kind, Result};

use super::{checked, labels};
use crate::http::state::Shared;
use crate::store::{Job, Summary};

/// The labels after an iteration of a flat clustering.
pub(crate) async fn labels(
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
    let file = SNAPSHOTS_NPY.file;
    let mut rows = checked::part(shared, job, file, GetRange::Suffix(from_end)).await?.into_reader();
    let faces = summary.faces;
    labels::made(shared, job, summary, file, form, move || labels::read(&mut rows, 0, faces)).await
}

/// The iterations whose labels were kept.
async fn list(shared: &Shared, job: &Job) -> Result<Vec<u32>> {
    let json = match checked::open(shared, job, SNAPSHOTS_JSON.file).await {
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
