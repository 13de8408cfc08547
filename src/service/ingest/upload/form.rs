//! Uploads as `multipart/form-data`: parts `mesh` or `points`, `parameters`, `buffer` (any number, told apart by file
//! name), `seeds`, `weights` and `graph`, in any order.

use std::collections::{BTreeMap, HashSet};
use std::error::Error as StdError;

use axum::body::Body;
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request};
use axum::http::request::Parts;
use futures_util::{Stream, TryStreamExt};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::{self, InputFormat};

use super::{Destination, Mesh, Saved, Upload, agreed, kept_name, spec_of};
use crate::files;
use crate::ingest::intake::Content;
use crate::ingest::request::{Beside, MAX_PARAMETERS_BYTES, Wanted};
use crate::store::Spec;

/// Largest number of buffers of a mesh.
const MAX_BUFFERS: usize = 1024;

pub(super) async fn receive(
    parts: Parts,
    content: Content,
    wanted: Wanted,
    into: Destination,
    mesh: Option<Mesh>,
) -> Result<Upload> {
    let Content { bytes, allowance } = content;
    allowance.between_parts();
    let request = Request::from_parts(parts, Body::from_stream(bytes));
    let mut multipart = Multipart::from_request(request, &())
        .await
        .map_err(|rejection| Error::new(Kind::BadRequest, rejection.body_text()))?;
    let mut form = Form {
        into,
        wanted,
        mesh,
        part: None,
        buffers: Vec::new(),
        names: HashSet::new(),
        digests: Vec::new(),
        beside: BTreeMap::new(),
        has_parameters: false,
    };
    while let Some(field) = multipart.next_field().await.map_err(unreadable)? {
        allowance.within_part();
        form.add(field).await?;
        allowance.between_parts();
    }
    form.finish()
}

struct Form {
    into: Destination,
    wanted: Wanted,
    /// From the beginning, if it lies in a bucket.
    mesh: Option<Mesh>,
    /// Name of the part that the mesh was.
    part: Option<&'static str>,
    buffers: Vec<String>,
    /// Of the buffers.
    names: HashSet<String>,
    /// Of the buffers.
    digests: Vec<[u8; 32]>,
    /// By their names, which are those of the parts.
    beside: BTreeMap<&'static str, Saved>,
    has_parameters: bool,
}

impl Form {
    async fn add(&mut self, field: Field<'_>) -> Result<()> {
        match field.name().unwrap_or_default() {
            "mesh" => self.add_mesh(field, "mesh").await,
            "points" => self.add_mesh(field, "points").await,
            "parameters" => {
                once("parameters", self.has_parameters)?;
                self.has_parameters = true;
                self.wanted.add_json(&small(field).await?)
            }
            "buffer" => self.add_buffer(field).await,
            "seeds" => self.add_beside(field, files::SEEDS, |_| Ok(())).await,
            "weights" => self.add_beside(field, files::WEIGHTS, job::check_head_of_weights).await,
            "graph" => self.add_beside(field, files::GRAPH, job::check_head_of_graph).await,
            "" => Err(Error::new(
                Kind::BadRequest,
                "a part of the form has no name (Content-Disposition: form-data; name=\"…\")",
            )),
            other => Err(Error::parameter(format_args!(
                "a part must be one of mesh, points, parameters, buffer, seeds, weights, graph, not {other:?}"
            ))),
        }
    }

    /// Saves a part that there is once, and checks its first bytes.
    async fn add_beside(
        &mut self,
        field: Field<'_>,
        name: &'static str,
        check_head: fn(&[u8]) -> Result<()>,
    ) -> Result<()> {
        once(name, self.beside.contains_key(name))?;
        let saved = self.into.save(content(field), name, |_| Ok(())).await?;
        check_head(&saved.head)?;
        self.beside.insert(name, saved);
        Ok(())
    }

    async fn add_mesh(&mut self, field: Field<'_>, part: &'static str) -> Result<()> {
        match &self.mesh {
            None => {}
            Some(Mesh { referred: Some(_), .. }) => {
                return Err(Error::parameter(
                    "mesh_url in the query says where the mesh lies: leave out the part mesh or points, or mesh_url",
                ));
            }
            Some(_) => {
                return Err(Error::parameter(format_args!(
                    "there is more than one part named mesh or points: leave out all but one, such as this: {part}"
                )));
            }
        }
        let file_name = file_name(&field).map(|name| kept_name(&name));
        let by_type = field.content_type().and_then(InputFormat::from_media_type);
        let format = agreed(by_type, self.wanted.format)?;
        let early = |head: &[u8]| {
            let format = format.map_or_else(|| InputFormat::recognise(file_name.as_deref(), head, None), Ok)?;
            check_part(part, format)?;
            format.check_head(head, None)
        };
        let saved = self.into.save(content(field), files::MESH, early).await?;
        self.mesh = Some(Mesh { saved, file_name, format, referred: None });
        self.part = Some(part);
        Ok(())
    }

    async fn add_buffer(&mut self, field: Field<'_>) -> Result<()> {
        let name = file_name(&field).unwrap_or_default();
        if name.is_empty() {
            return Err(Error::parameter("a part buffer needs a file name: the URI that the mesh refers to it by"));
        }
        if !self.names.insert(name.clone()) {
            return Err(Error::parameter(format_args!("two parts buffer have the same file name: {name:?}")));
        }
        if self.buffers.len() == MAX_BUFFERS {
            return Err(Error::too_large(format_args!(
                "there are more parts named buffer than the limit of {MAX_BUFFERS}"
            )));
        }
        let blob = files::buffer(self.buffers.len());
        self.digests.extend(self.into.save(content(field), &blob, |_| Ok(())).await?.digest);
        self.buffers.push(name);
        Ok(())
    }

    fn finish(self) -> Result<Upload> {
        let mesh = self.mesh.ok_or_else(|| {
            Error::parameter(
                "the form has no part named mesh or points: send the mesh or the points as one, or name them in the \
                 query (mesh_url)",
            )
        })?;
        let format = mesh.format()?;
        self.part.map_or(Ok(()), |part| check_part(part, format))?;
        let Mesh { saved, file_name, referred, .. } = mesh;
        if !self.buffers.is_empty() && !format.has_buffers() {
            return Err(Error::parameter(format_args!(
                "{} refers to no buffers: leave out the part buffer with file name {:?}",
                format.noun(),
                self.buffers[0]
            )));
        }
        let has = |name| self.beside.contains_key(name);
        let parts =
            Beside { listed_seeds: has(files::SEEDS), has_weights: has(files::WEIGHTS), has_graph: has(files::GRAPH) };
        let spec = spec_of(self.wanted, format, saved.bytes, parts)?;
        if let Some(name) = spec.parameters.weight_attribute.as_ref().filter(|_| parts.has_weights) {
            return Err(Error::parameter(format_args!(
                "the part weights and the parameter weight_attribute exclude each other: leave out {name:?}"
            )));
        }
        let files = std::iter::once(&saved).chain(self.beside.values());
        let digests: Vec<_> = files.filter_map(|saved| saved.digest).chain(self.digests).collect();
        let spec = Spec { file_name, buffers: self.buffers, referred, ..spec };
        Ok(Upload { folder: self.into.folder, spec, digests })
    }
}

/// Refuses points in the part of meshes, and a mesh in that of points.
fn check_part(part: &str, format: InputFormat) -> Result<()> {
    let right = if format.is_of_points() { "points" } else { "mesh" };
    match part == right {
        true => Ok(()),
        false => Err(Error::parameter(format_args!(
            "the part {part} is {} file: send it as a part named {right}",
            format.noun()
        ))),
    }
}

/// Refuses a part that was there before.
fn once(name: &str, there: bool) -> Result<()> {
    if there {
        return Err(Error::parameter(format_args!("there is more than one part of that name: {name}")));
    }
    Ok(())
}

fn content(field: Field<'_>) -> impl Stream<Item = Result<axum::body::Bytes>> + Unpin {
    field.map_err(unreadable)
}

async fn small(field: Field<'_>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut content = content(field);
    while let Some(chunk) = content.try_next().await? {
        bytes.extend_from_slice(&chunk);
        if bytes.len() as u64 > MAX_PARAMETERS_BYTES {
            return Err(Error::too_large(format_args!(
                "the part \"parameters\" has more bytes than the limit of {MAX_PARAMETERS_BYTES}"
            )));
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
    let mut source: Option<&(dyn StdError + 'static)> = Some(&error);
    while let Some(cause) = source {
        if let Some(ours) = cause.downcast_ref::<Error>() {
            return ours.clone();
        }
        source = cause.source();
    }
    Error::new(Kind::BadRequest, format_args!("the form cannot be read: {}", error.body_text()))
}
