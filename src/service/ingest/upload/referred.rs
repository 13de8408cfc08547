//! Uploads whose mesh lies in a bucket: `mesh_url` in the query names it.

use futures_util::StreamExt as _;
use object_store::GetRange;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::HEAD_BYTES;

use super::{Destination, Mesh, Saved, Upload, kept_name, spec_of};
use crate::files::{Files, Incoming};
use crate::ingest::intake::{Content, Rules};
use crate::ingest::request::{Beside, Wanted};
use crate::store::{Referred, Spec};

/// Finds the mesh of an upload, and reads its head.
pub(super) async fn find(
    url: &str,
    format: Option<InputFormat>,
    files: &Files,
    folder: &mut Incoming,
    tenant: &str,
    rules: &Rules,
) -> Result<Mesh> {
    let found = files.find_referred(tenant, url).await?;
    if found.size > rules.limit {
        return Err(rules.too_large(found.size));
    }
    let referred = Referred { url: url.to_owned(), tag: found.e_tag };
    let head = match found.size {
        0 => Vec::new(),
        bytes => {
            let range = GetRange::Bounded(0..bytes.min(HEAD_BYTES as u64));
            files.read_referred(tenant, &referred, Some(range)).await?.bytes().await?.into()
        }
    };
    folder.is_referred();
    let saved = Saved { bytes: found.size, head, digest: None };
    Ok(Mesh { saved, file_name: url.rsplit('/').next().map(kept_name), format, referred: Some(referred) })
}

/// Makes an upload of a request without a body.
pub(super) async fn without_body(
    mut content: Content,
    wanted: Wanted,
    into: Destination,
    mesh: Mesh,
) -> Result<Upload> {
    while let Some(chunk) = content.bytes.next().await {
        if !chunk?.is_empty() {
            return Err(Error::new(
                Kind::BadRequest,
                "mesh_url in the query says where the mesh lies, so the body must be empty, or a form without a part \
                 named mesh",
            ));
        }
    }
    let spec = spec_of(wanted, mesh.format()?, mesh.saved.bytes, Beside::default())?;
    let spec = Spec { file_name: mesh.file_name, referred: mesh.referred, ..spec };
    Ok(Upload { folder: into.folder, spec, digests: Vec::new() })
}
