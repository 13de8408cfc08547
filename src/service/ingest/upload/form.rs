//! Uploads as `multipart/form-data`: parts `mesh` or `points`, `parameters`, `buffer` (any number, told apart by file
//! name), `seeds`, `weights` and `graph`, in any order.

use std::error::Error as StdError;
use std::iter;

use axum::body::{Body, Bytes};
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request};
use axum::http::request::Parts;
use futures_util::{Stream, TryStreamExt};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::{self, InputFormat};

use super::{Mesh, Received, kept_name};
use crate::files;
use crate::ingest::intake::Content;

/// Largest JSON part with parameters, in bytes.
const MAX_PARAMETERS_BYTES: usize = 64 << 10;

/// Largest number of buffers of a mesh.
const MAX_BUFFERS: usize = 1024;

pub(super) async fn receive(parts: Parts, content: Content, received: &mut Received) -> Result<()> {
    let Content { bytes, counts } = content;
    counts.between_parts();
    let request = Request::from_parts(parts, Body::from_stream(bytes));
    let mut multipart = Multipart::from_request(request, &())
        .await
        .map_err(|rejection| Error::new(Kind::BadRequest, rejection.body_text()))?;
    let mut has_parameters = false;
    while let Some(field) = multipart.next_field().await.map_err(unreadable)? {
        counts.within_part();
        match field.name().unwrap_or_default() {
            "mesh" => add_mesh(received, field, "mesh").await?,
            "points" => add_mesh(received, field, "points").await?,
            "parameters" => {
                once("parameters", has_parameters)?;
                has_parameters = true;
                received.wanted.add_json(&small(field).await?)?;
            }
            "buffer" => add_buffer(received, field).await?,
            "seeds" => add_beside(received, field, files::SEEDS, |_| Ok(())).await?,
            "weights" => add_beside(received, field, files::WEIGHTS, job::check_head_of_weights).await?,
            "graph" => add_beside(received, field, files::GRAPH, job::check_head_of_graph).await?,
            "" => {
                let message = "a part of the form has no name (Content-Disposition: form-data; name=\"…\")";
                return Err(Error::new(Kind::BadRequest, message));
            }
            other => {
                return Err(Error::parameter(format_args!(
                    "a part must be one of mesh, points, parameters, buffer, seeds, weights, graph, not {other:?}"
                )));
            }
        }
        counts.between_parts();
    }
    Ok(())
}

async fn add_mesh(received: &mut Received, field: Field<'_>, part: &'static str) -> Result<()> {
    if let Some(Mesh { referred, .. }) = &received.mesh {
        return Err(Error::parameter(match referred {
            Some(_) => {
                "mesh_url in the query says where the mesh lies: leave out the part mesh or points, or mesh_url".into()
            }
            None => {
                format!("there is more than one part named mesh or points: leave out all but one, such as this: {part}")
            }
        }));
    }
    let file_name = file_name(&field).map(|name| kept_name(&name));
    let by_type = field.content_type().and_then(InputFormat::from_media_type);
    received.add_mesh(content(field), file_name, by_type, None, Some(part)).await
}

/// Saves a part that there is once, and checks its first bytes.
async fn add_beside(
    received: &mut Received,
    field: Field<'_>,
    name: &'static str,
    check_head: fn(&[u8]) -> Result<()>,
) -> Result<()> {
    once(name, received.beside.contains_key(name))?;
    let saved = received.save(content(field), name, |_| Ok(())).await?;
    check_head(&saved.head)?;
    received.beside.insert(name, saved);
    Ok(())
}

async fn add_buffer(received: &mut Received, field: Field<'_>) -> Result<()> {
    let name = file_name(&field).unwrap_or_default();
    if name.is_empty() {
        return Err(Error::parameter("a part buffer needs a file name: the URI that the mesh refers to it by"));
    }
    if received.buffers.contains(&name) {
        return Err(Error::parameter(format_args!("two parts buffer have the same file name: {name:?}")));
    }
    if received.buffers.len() == MAX_BUFFERS {
        let message = format_args!("there are more parts named buffer than the limit of {MAX_BUFFERS}");
        return Err(Error::too_large(message));
    }
    let blob = files::buffer(received.buffers.len());
    let saved = received.save(content(field), &blob, |_| Ok(())).await?;
    received.digests.extend(saved.digest);
    received.buffers.push(name);
    Ok(())
}

/// Refuses a part that was there before.
fn once(name: &str, there: bool) -> Result<()> {
    match there {
        true => Err(Error::parameter(format_args!("there is more than one part of that name: {name}"))),
        false => Ok(()),
    }
}

fn content(field: Field<'_>) -> impl Stream<Item = Result<Bytes>> + Unpin {
    field.map_err(unreadable)
}

async fn small(field: Field<'_>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut content = content(field);
    while let Some(chunk) = content.try_next().await? {
        bytes.extend_from_slice(&chunk);
        if bytes.len() > MAX_PARAMETERS_BYTES {
            let message =
                format_args!("the part \"parameters\" has more bytes than the limit of {MAX_PARAMETERS_BYTES}");
            return Err(Error::too_large(message));
        }
    }
    Ok(bytes)
}

/// The file name of a part. Browsers write a quotation mark in it as `%22` (HTML Standard §4.10.22.8), and nothing else
/// that a file name has is encoded.
fn file_name(field: &Field<'_>) -> Option<String> {
    field.file_name().map(|name| name.replace("%22", "\""))
}

/// The error of a form that cannot be read on: what [`Content`] refused, or what is wrong with the form.
fn unreadable(error: MultipartError) -> Error {
    let first: &(dyn StdError + 'static) = &error;
    let ours = iter::successors(Some(first), |&cause| cause.source()).find_map(|cause| cause.downcast_ref::<Error>());
    let refused = || Error::new(Kind::BadRequest, format_args!("the form cannot be read: {}", error.body_text()));
    ours.cloned().unwrap_or_else(refused)
}
