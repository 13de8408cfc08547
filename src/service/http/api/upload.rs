//! The mesh of a job as it was uploaded.

use axum::extract::{Path, State as Extract};
use axum::http::Uri;
use serde::Deserialize;
use tesserae_mesh::error::{Error, Kind, Quoted};
use utoipa::IntoParams;

use super::binary::Binary;
use crate::files::{self, kept_mesh};
use crate::guard::access::Caller;
use crate::guard::problem::{Answer, Problematic};
use crate::guard::query;
use crate::http::results::stored::{Of, attachment, stored};
use crate::http::state::App;

/// The query of an upload.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct UploadQuery {
    /// The buffer of this name, one of the job's `mesh.buffers`, in place of the mesh
    buffer: Option<String>,
}

/// Get the upload
///
/// The mesh as it was uploaded, in the format that `mesh.format` of the job names, or one of its buffers. It is there
/// while the job waits and runs, and of a failed job that can be run again, but for one that was named by a `mesh_url`.
/// An image that is kept is there with the result. 404 otherwise.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/upload", tag = "jobs", operation_id = "getUpload",
    params(UploadQuery),
    responses(
        (status = 200, description = "The bytes", body = Binary, content_type = "application/octet-stream"),
        (status = 206, description = "The part of them that `Range` names", body = Binary,
         content_type = "application/octet-stream"),
        (status = 304, description = "The client has them already (`If-None-Match`)"),
        (status = 416, response = Problematic),
        (status = 422, response = Problematic),
    ),
)]
pub(crate) async fn upload(Extract(shared): App, caller: Caller, Path(id): Path<String>, uri: Uri) -> Answer {
    let job = shared.job(&caller, &id).await?;
    let UploadQuery { buffer } = query::read(&uri)?;
    let (blob, file) = match buffer {
        None => (files::MESH.to_owned(), format!("upload.{}", job.spec.format.name())),
        Some(name) => {
            let index = job.spec.buffers.iter().position(|buffer| *buffer == name).ok_or_else(|| {
                let known = job.spec.buffers.join(", ");
                Error::parameter(format_args!("buffer must be one of the job's ({known}), not {}", Quoted(&name)))
            })?;
            (files::buffer(index), format!("buffer-{index}.bin"))
        }
    };
    let is_kept = job.has_image();
    if !job.has_upload() && !is_kept {
        let message = format_args!(
            "an upload is kept until its job ends, and what a mesh_url names is read at its place; keep_mesh=true \
             keeps an image with the result. The job is {}",
            job.state.name()
        );
        return Err(Error::new(Kind::NotFound, message).into());
    }
    let (of, blob) = if is_kept { (Of::Result, kept_mesh::IMAGE) } else { (Of::Upload, &blob[..]) };
    let mut response = stored(&shared, &job, of, blob, 0, "application/octet-stream").await?;
    attachment(&mut response, &job, &file);
    Ok(response)
}
