//! Uploads: the body of a job request, from its first byte to a folder of files and a [`Spec`].
//!
//! What the head of the request says is checked before the body is read, every part as soon as it is there; the mesh
//! goes to disk as it comes. When anything is refused, or the client hangs up, the folder is removed. Of a mesh
//! that lies in a bucket only the head is read (`referred`).

mod form;
mod referred;

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::Request;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use futures_util::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::HEAD_BYTES;

use crate::files::{self, Files, Incoming};
use crate::guard::problem::{ACCEPTED, ENCODINGS};
use crate::ingest::intake::{self, Coding, Content, Rules};
use crate::ingest::request::{Beside, Wanted};
use crate::store::{Referred, Spec};

/// Longest file name that is kept, in characters.
const MAX_NAME: usize = 255;

/// An upload that is whole and was found in order.
pub(crate) struct Upload {
    pub folder: Incoming,
    pub spec: Spec,
    /// SHA-256 of each file: the mesh, seeds and weights if there are any, the buffers. Empty unless requested.
    pub digests: Vec<[u8; 32]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BodyKind {
    /// The mesh or the points, of this format if the media type says so.
    Mesh(Option<InputFormat>),
    /// `multipart/form-data`.
    Form,
}

/// Receives an upload for a tenant, with [digests](Upload::digests) where the caller needs them. The caller sets the
/// trace.
pub(crate) async fn receive(
    request: Request,
    files: &Arc<Files>,
    tenant: &str,
    with_digests: bool,
    rules: Rules,
) -> Result<Upload> {
    let (parts, body) = request.into_parts();
    let wanted = Wanted::from_query(&parts.uri)?;
    let coding = coding(&parts.headers)?;
    let kind = body_kind(&parts.headers)?;
    wanted.check_early(kind == BodyKind::Form)?;
    let length = content_length(&parts.headers);
    let content = intake::open(body, coding, length, rules.clone())?;
    let length = length.filter(|_| coding.is_none());
    let mut folder = files.incoming();
    let referred = match &wanted.mesh_url {
        None => None,
        Some(url) => Some(referred::find(url, wanted.format, files, &mut folder, tenant, &rules).await?),
    };
    let into = Destination { folder, with_digests };
    let mut upload = match (kind, referred) {
        (BodyKind::Form, referred) => form::receive(parts, content, wanted, into, referred).await,
        (BodyKind::Mesh(_), Some(mesh)) => referred::without_body(content, wanted, into, mesh).await,
        (BodyKind::Mesh(format), None) => raw(&parts, content, wanted, format, length, into).await,
    }?;
    upload.spec.tenant = tenant.to_owned();
    Ok(upload)
}

/// A file name of a client's, as it is kept.
fn kept_name(name: &str) -> String {
    name.chars().take(MAX_NAME).collect()
}

fn coding(headers: &HeaderMap) -> Result<Option<Coding>> {
    let Some(encoding) = headers.get(header::CONTENT_ENCODING) else {
        return Ok(None);
    };
    match encoding.to_str().unwrap_or_default().trim().to_ascii_lowercase().as_str() {
        "identity" | "" => Ok(None),
        "gzip" | "x-gzip" => Ok(Some(Coding::Gzip)),
        "zstd" => Ok(Some(Coding::Zstd)),
        _ => Err(Error::new(
            Kind::UnsupportedMediaType,
            format_args!("Content-Encoding must be one of {ENCODINGS}, once, not {encoding:?}"),
        )),
    }
}

/// Receives a body that is the mesh itself.
async fn raw(
    parts: &Parts,
    content: Content,
    wanted: Wanted,
    format: Option<InputFormat>,
    length: Option<u64>,
    mut into: Destination,
) -> Result<Upload> {
    let format = agreed(format, wanted.format)?;
    let early = |head: &[u8]| match format {
        Some(format) => format.check_head(head, length),
        None => InputFormat::recognise(None, head, length)?.check_head(head, length),
    };
    let saved = into.save(content.bytes, files::MESH, early).await?;
    let mesh = Mesh { saved, file_name: None, format, referred: None };
    let spec = spec_of(wanted, mesh.format()?, mesh.saved.bytes, Beside::default())?;
    tracing::debug!(bytes = mesh.saved.bytes, path = parts.uri.path(), "received a mesh");
    Ok(Upload { folder: into.folder, digests: mesh.saved.digest.into_iter().collect(), spec })
}

/// A mesh of so many bytes without a name, and what came beside it.
fn spec_of(wanted: Wanted, format: InputFormat, bytes: u64, parts: Beside) -> Result<Spec> {
    let (priority, kept) = (wanted.priority, wanted.kept.clone());
    let (parameters, webhook) = wanted.finish(format, parts)?;
    let Beside { listed_seeds, has_weights, has_graph } = parts;
    Ok(Spec {
        tenant: String::new(),
        trace_parent: None,
        webhook,
        parameters,
        file_name: None,
        format,
        bytes,
        buffers: Vec::new(),
        listed_seeds,
        has_weights,
        has_graph,
        is_small: false,
        priority,
        kept,
        referred: None,
    })
}

fn body_kind(headers: &HeaderMap) -> Result<BodyKind> {
    let unsupported = |message: String| Err(Error::new(Kind::UnsupportedMediaType, message));
    let Some(content_type) = headers.get(header::CONTENT_TYPE) else {
        return Ok(BodyKind::Mesh(None));
    };
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

/// The format that a media type and `?format=` agree on.
fn agreed(by_type: Option<InputFormat>, by_query: Option<InputFormat>) -> Result<Option<InputFormat>> {
    match (by_type, by_query) {
        (Some(by_type), Some(by_query)) if by_type != by_query => Err(Error::parameter(format_args!(
            "media type and parameter format contradict each other: {} and {}",
            by_type.media_type(),
            by_query.name()
        ))),
        _ => Ok(by_type.or(by_query)),
    }
}

pub(crate) fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

#[derive(Debug)]
struct Saved {
    bytes: u64,
    /// Its first bytes, by which its format is recognised.
    head: Vec<u8>,
    /// Its SHA-256, if that is wanted.
    digest: Option<[u8; 32]>,
}

/// The mesh or the points of an upload.
struct Mesh {
    saved: Saved,
    file_name: Option<String>,
    /// What the request says that it is, if it does.
    format: Option<InputFormat>,
    /// Where it lies, of one in a bucket.
    referred: Option<Referred>,
}

impl Mesh {
    /// The format, once it was checked that the file can be of it.
    fn format(&self) -> Result<InputFormat> {
        let Saved { bytes, head, .. } = &self.saved;
        if *bytes == 0 {
            return Err(Error::mesh("the file is empty"));
        }
        let recognise = || InputFormat::recognise(self.file_name.as_deref(), head, Some(*bytes));
        let format = self.format.map_or_else(recognise, Ok)?;
        format.check_head(head, Some(*bytes))?;
        Ok(format)
    }
}

struct Destination {
    folder: Incoming,
    with_digests: bool,
}

impl Destination {
    /// Writes a stream to a new blob. `early` sees the first bytes as soon as they are there and may refuse them.
    async fn save<S>(&mut self, mut stream: S, name: &str, early: impl Fn(&[u8]) -> Result<()>) -> Result<Saved>
    where
        S: Stream<Item = Result<Bytes>> + Unpin,
    {
        let mut blob = self.folder.blob(name);
        let mut saved = Saved { bytes: 0, head: Vec::new(), digest: None };
        let mut digest = self.with_digests.then(Sha256::new);
        while let Some(chunk) = stream.next().await {
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
}
