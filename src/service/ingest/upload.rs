//! Uploads: the body of a job request, from its first byte to a folder of files and a [`Spec`].
//!
//! What the head of the request says is checked before the body is read, every part as soon as it is there; the mesh
//! goes to disk as it comes. When anything is refused, or the client hangs up, the folder is removed. Of a mesh that
//! lies in a bucket (`mesh_url`) only the head is read.

mod form;

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::Request;
use axum::http::{HeaderMap, header};
use futures_util::{Stream, StreamExt};
use object_store::GetRange;
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::HEAD_BYTES;

use crate::files::{self, Files, Incoming};
use crate::guard::problem::{ACCEPTED, ENCODINGS};
use crate::ingest::intake::{self, Coding, Rules};
use crate::ingest::request::WantedJob;
use crate::store::{Referred, Spec};

/// An upload that is whole and was found in order.
pub(crate) struct Upload {
    pub folder: Incoming,
    pub spec: Spec,
    /// SHA-256 of each file: the mesh, what came beside it by name, the buffers. Empty unless requested.
    pub digests: Vec<[u8; 32]>,
}

enum BodyKind {
    /// The mesh or the points, of this format if the media type says so.
    Mesh(Option<InputFormat>),
    Form,
}

/// Receives an upload for a tenant, with [`Upload::digests`] where the caller needs them. The caller sets the trace.
pub(crate) async fn receive(
    request: Request,
    files: &Arc<Files>,
    tenant: &str,
    with_digests: bool,
    rules: Rules,
) -> Result<Upload> {
    let (parts, body) = request.into_parts();
    let wanted = WantedJob::from_query(&parts.uri)?;
    let coding = coding(&parts.headers)?;
    let kind = body_kind(&parts.headers)?;
    wanted.check_early(matches!(kind, BodyKind::Form))?;
    let length = content_length(&parts.headers);
    let mut content = intake::open(body, coding, length, rules.clone())?;
    let length = length.filter(|_| coding.is_none());
    let mut received = Received {
        folder: files.incoming(),
        with_digests,
        wanted,
        mesh: None,
        buffers: Vec::new(),
        digests: Vec::new(),
        beside: BTreeMap::new(),
    };
    if let Some(url) = received.wanted.mesh_url.take() {
        received.refer(url, files, tenant, &rules).await?;
    }
    match kind {
        BodyKind::Form => form::receive(parts, content, &mut received).await?,
        BodyKind::Mesh(format) if received.mesh.is_none() => {
            received.add_mesh(content.bytes, None, format, length, None).await?;
        }
        BodyKind::Mesh(_) => {
            while let Some(chunk) = content.bytes.next().await {
                if !chunk?.is_empty() {
                    let message = "mesh_url in the query says where the mesh lies, so the body must be empty, or a \
                                   form without a part named mesh";
                    return Err(Error::new(Kind::BadRequest, message));
                }
            }
        }
    }
    received.finish(tenant)
}

fn coding(headers: &HeaderMap) -> Result<Option<Coding>> {
    let Some(encoding) = headers.get(header::CONTENT_ENCODING) else { return Ok(None) };
    match encoding.to_str().unwrap_or_default().trim().to_ascii_lowercase().as_str() {
        "identity" | "" => Ok(None),
        "gzip" | "x-gzip" => Ok(Some(Coding::Gzip)),
        "zstd" => Ok(Some(Coding::Zstd)),
        _ => {
            let message = format_args!("Content-Encoding must be one of {ENCODINGS}, once, not {encoding:?}");
            Err(Error::new(Kind::UnsupportedMediaType, message))
        }
    }
}

fn body_kind(headers: &HeaderMap) -> Result<BodyKind> {
    let unsupported = |message: String| Err(Error::new(Kind::UnsupportedMediaType, message));
    let Some(content_type) = headers.get(header::CONTENT_TYPE) else { return Ok(BodyKind::Mesh(None)) };
    let content_type = content_type.to_str().unwrap_or_default();
    let essence = content_type.split(';').next().unwrap_or_default().trim();
    if let Some(format) = InputFormat::from_media_type(essence) {
        return Ok(BodyKind::Mesh(Some(format)));
    }
    match essence.to_ascii_lowercase().as_str() {
        "application/octet-stream" => Ok(BodyKind::Mesh(None)),
        "multipart/form-data" => Ok(BodyKind::Form),
        "application/x-www-form-urlencoded" => unsupported(format!(
            "a mesh is no application/x-www-form-urlencoded (which curl says when it is not told otherwise): \
             say what it is, as with -H 'Content-Type: model/obj'; one of {}",
            *ACCEPTED
        )),
        _ => unsupported(format!("the body must be one of {}, not {essence:?}", *ACCEPTED)),
    }
}

pub(crate) fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

struct Received {
    folder: Incoming,
    with_digests: bool,
    wanted: WantedJob,
    mesh: Option<Mesh>,
    buffers: Vec<String>,
    /// Of the buffers.
    digests: Vec<[u8; 32]>,
    /// By their names, which are those of the parts.
    beside: BTreeMap<&'static str, Saved>,
}

/// The mesh or the points of an upload.
struct Mesh {
    saved: Saved,
    file_name: Option<String>,
    /// What the request says that it is, if it does.
    format: Option<InputFormat>,
    /// Name of the part that it was, of a form.
    part: Option<&'static str>,
    /// Where it lies, of one in a bucket.
    referred: Option<Referred>,
}

struct Saved {
    bytes: u64,
    /// Its first bytes, by which its format is recognised.
    head: Vec<u8>,
    /// Its SHA-256, if that is wanted.
    digest: Option<[u8; 32]>,
}

impl Received {
    /// Finds a mesh in a bucket, and reads its head.
    async fn refer(&mut self, url: String, files: &Files, tenant: &str, rules: &Rules) -> Result<()> {
        let found = files.find_referred(tenant, &url).await?;
        rules.check(found.size)?;
        let file_name = url.rsplit('/').next().map(kept_name);
        let referred = Referred { url, tag: found.e_tag };
        let mut head = Vec::new();
        if found.size > 0 {
            let range = GetRange::Bounded(0..found.size.min(HEAD_BYTES as u64));
            head = files.read_referred(tenant, &referred, Some(range)).await?.bytes().await?.into();
        }
        self.folder.is_referred();
        let saved = Saved { bytes: found.size, head, digest: None };
        let format = self.wanted.format;
        self.mesh = Some(Mesh { saved, file_name, format, part: None, referred: Some(referred) });
        Ok(())
    }

    async fn add_mesh(
        &mut self,
        bytes: impl Stream<Item = Result<Bytes>> + Unpin,
        file_name: Option<String>,
        by_type: Option<InputFormat>,
        length: Option<u64>,
        part: Option<&'static str>,
    ) -> Result<()> {
        if let (Some(by_type), Some(by_query)) = (by_type, self.wanted.format)
            && by_type != by_query
        {
            let (by_type, by_query) = (by_type.media_type(), by_query.name());
            let message =
                format_args!("media type and parameter format contradict each other: {by_type} and {by_query}");
            return Err(Error::parameter(message));
        }
        let format = by_type.or(self.wanted.format);
        let early = |head: &[u8]| check_mesh(head, file_name.as_deref(), format, length, part).map(drop);
        let saved = self.save(bytes, files::MESH, early).await?;
        self.mesh = Some(Mesh { saved, file_name, format, part, referred: None });
        Ok(())
    }

    /// Writes a stream to a new blob. `early` sees the first bytes as soon as they are there and may refuse them.
    async fn save(
        &mut self,
        mut bytes: impl Stream<Item = Result<Bytes>> + Unpin,
        name: &str,
        early: impl Fn(&[u8]) -> Result<()>,
    ) -> Result<Saved> {
        let mut blob = self.folder.blob(name);
        let mut saved = Saved { bytes: 0, head: Vec::new(), digest: None };
        let mut digest = self.with_digests.then(Sha256::new);
        while let Some(chunk) = bytes.next().await {
            let chunk = chunk?;
            saved.bytes += chunk.len() as u64;
            let more = HEAD_BYTES - saved.head.len();
            saved.head.extend_from_slice(&chunk[..more.min(chunk.len())]);
            if more > 0 && saved.head.len() == HEAD_BYTES {
                early(&saved.head)?;
            }
            if let Some(digest) = &mut digest {
                digest.update(&chunk);
            }
            blob.write(&chunk).await?;
        }
        self.folder.add(blob).await?;
        saved.digest = digest.map(|digest| digest.finalize().into());
        Ok(saved)
    }

    fn finish(self, tenant: &str) -> Result<Upload> {
        let Mesh { saved, file_name, format, part, referred } = self.mesh.ok_or_else(|| {
            Error::parameter(
                "the form has no part named mesh or points: send the mesh or the points as one, or name them in the \
                 query (mesh_url)",
            )
        })?;
        if saved.bytes == 0 {
            return Err(Error::mesh("the file is empty"));
        }
        let format = check_mesh(&saved.head, file_name.as_deref(), format, Some(saved.bytes), part)?;
        if let Some(buffer) = self.buffers.first().filter(|_| !format.has_buffers()) {
            let noun = format.noun();
            let message =
                format_args!("{noun} refers to no buffers: leave out the part buffer with file name {buffer:?}");
            return Err(Error::parameter(message));
        }
        let spec = self.wanted.finish(format, |part| self.beside.contains_key(part))?;
        if let Some(name) = spec.parameters.weight_attribute.as_ref().filter(|_| spec.has_weights) {
            return Err(Error::parameter(format_args!(
                "the part weights and the parameter weight_attribute exclude each other: leave out {name:?}"
            )));
        }
        let files = std::iter::once(&saved).chain(self.beside.values());
        let digests = files.filter_map(|saved| saved.digest).chain(self.digests).collect();
        let (tenant, bytes, buffers) = (tenant.to_owned(), saved.bytes, self.buffers);
        Ok(Upload { folder: self.folder, spec: Spec { tenant, file_name, bytes, buffers, referred, ..spec }, digests })
    }
}

/// The format of a mesh, recognised where the request does not say it. Its first bytes and its part must go with it.
fn check_mesh(
    head: &[u8],
    file_name: Option<&str>,
    format: Option<InputFormat>,
    length: Option<u64>,
    part: Option<&str>,
) -> Result<InputFormat> {
    let format = format.map_or_else(|| InputFormat::recognise(file_name, head, length), Ok)?;
    let right = if format.is_of_points() { "points" } else { "mesh" };
    if let Some(part) = part.filter(|part| *part != right) {
        let message = format_args!("the part {part} is {} file: send it as a part named {right}", format.noun());
        return Err(Error::parameter(message));
    }
    format.check_head(head, length)?;
    Ok(format)
}

/// A file name of a client's, as it is kept: at most 255 characters of it.
fn kept_name(name: &str) -> String {
    name.chars().take(255).collect()
}
