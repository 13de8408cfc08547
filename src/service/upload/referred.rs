//! Uploads whose mesh lies in a bucket: `upload` or `mesh_url` in the query names it.

use std::sync::Arc;

use futures_util::StreamExt as _;
use object_store::GetRange;
use sha2::{Digest as _, Sha256};

use super::{Destination, KEPT, Saved, Upload, kept_name, reservation, spec_of};
use crate::error::{Error, Kind, Result};
use crate::mesh::Format;
use crate::service::blobs::Found;
use crate::service::files::{Files, Incoming};
use crate::service::intake::{Content, Rules};
use crate::service::request::{MeshAt, Wanted};
use crate::service::store::{Job, JobId, PartsOfRequest, Queue, Referred, Reservation, Reservations};

/// A mesh in a bucket.
pub(super) struct Mesh {
    pub saved: Saved,
    pub file_name: Option<String>,
    pub referred: Referred,
    /// The job that was made of it before.
    pub earlier: Option<Job>,
}

impl Mesh {
    /// Its format, which the request may say.
    pub fn format(&self, declared: Option<Format>) -> Result<Format> {
        match &self.earlier {
            Some(job) => Ok(declared.unwrap_or(job.spec.format)),
            None => self.saved.format(declared, self.file_name.as_deref()),
        }
    }
}

/// Finds the mesh, and the folder of what comes with it. An upload that is a job already is not looked at again: it may
/// be gone with the job's end.
pub(super) async fn find(
    at: &MeshAt,
    files: &Arc<Files>,
    store: &dyn Reservations,
    tenant: &str,
    rules: &Rules,
) -> Result<(Incoming, Mesh)> {
    let mut reserved = None;
    let (mut folder, url) = match at {
        MeshAt::Upload(id) => {
            let folder = files.incoming_reserved(*id)?;
            // read before the job: the creation of that removes the reservation
            let found = reservation(*id, files, store, tenant).await;
            let is_its = |job: &Job| job.spec.tenant == tenant && job.spec.is_of_upload_by_url();
            if let Some(job) = store.get(*id).await?.filter(is_its) {
                return Ok((files.incoming(), earlier(job)));
            }
            reserved = Some(found?);
            (folder, None)
        }
        MeshAt::Url(url) => (files.incoming(), Some(url.clone())),
    };
    let found = files.find_referred(folder.id(), tenant, url.as_deref()).await?;
    if let Some(Reservation { bytes, .. }) = reserved.as_ref().filter(|reserved| reserved.bytes != found.bytes) {
        return Err(wrong_size(folder.id(), files, store, *bytes, found.bytes).await?);
    }
    let file_name = match &url {
        Some(url) => url.rsplit('/').next().map(kept_name),
        None => reserved.and_then(|reserved| reserved.file_name),
    };
    let mesh = look(folder.id(), files, tenant, url, file_name, found, rules).await?;
    folder.refers_to(mesh.saved.bytes);
    Ok((folder, mesh))
}

/// The error of an upload by URL that has another number of bytes than reserved: no signature says how many its URL
/// takes. One with more is removed.
async fn wrong_size(id: JobId, files: &Files, store: &dyn Queue, reserved: u64, bytes: u64) -> Result<Error> {
    if bytes < reserved {
        return Ok(Error::new(
            Kind::Conflict,
            format_args!(
                "the upload was reserved for {reserved} bytes: PUT the whole mesh to its URL, or reserve another one; \
                 it has bytes: {bytes}"
            ),
        ));
    }
    // unless another service made a job of it in this moment
    if store.get(id).await?.is_none() {
        files.remove_upload(id).await;
    }
    Ok(Error::too_large(format_args!(
        "the upload was reserved for {reserved} bytes, and what was stored at its URL is larger and is not kept: \
         PUT the mesh there that was reserved for, or reserve another upload; it had bytes: {bytes}"
    )))
}

/// Reads the head of a mesh.
async fn look(
    id: JobId,
    files: &Files,
    tenant: &str,
    url: Option<String>,
    file_name: Option<String>,
    found: Found,
    rules: &Rules,
) -> Result<Mesh> {
    if found.bytes > rules.limit {
        return Err(rules.too_large(found.bytes));
    }
    let referred = Referred { url, tag: found.tag, parts: None };
    let head = match found.bytes {
        0 => Vec::new(),
        bytes => {
            let range = GetRange::Bounded(0..bytes.min(KEPT as u64));
            files.read_referred(id, tenant, &referred, Some(range)).await?.bytes().await?.into()
        }
    };
    Ok(Mesh { saved: Saved { bytes: found.bytes, head, digest: None }, file_name, referred, earlier: None })
}

/// Notes what came with the request for the job of an upload by URL, also where that is a job already.
pub(super) fn with_parts(referred: Referred, folder: &Incoming, digests: &[[u8; 32]]) -> Referred {
    let has_parts = referred.url.is_none() && !digests.is_empty();
    let parts = has_parts.then(|| PartsOfRequest {
        folder: folder.parts().unwrap_or_default().to_string(),
        sha256: Sha256::digest(digests.concat()).iter().map(|byte| format!("{byte:02x}")).collect(),
    });
    Referred { parts, ..referred }
}

/// What a job's upload was.
fn earlier(job: Job) -> Mesh {
    Mesh {
        saved: Saved { bytes: job.spec.bytes, head: Vec::new(), digest: None },
        file_name: job.spec.file_name.clone(),
        referred: Referred {
            url: None,
            tag: job.spec.referred.as_ref().and_then(|known| known.tag.clone()),
            parts: None,
        },
        earlier: Some(job),
    }
}

/// Makes an upload of a request without a body.
pub(super) async fn without_body(
    mut content: Content,
    wanted: Wanted,
    into: Destination,
    mesh: Mesh,
) -> Result<Upload> {
    while let Some(chunk) = content.next().await {
        if !chunk?.is_empty() {
            return Err(Error::new(
                Kind::BadRequest,
                "the query says where the mesh lies (upload, mesh_url), so the body must be empty, or a form without \
                 a part named mesh",
            ));
        }
    }
    let mut spec = spec_of(wanted.clone(), mesh.format(wanted.format)?, mesh.saved.bytes)?;
    spec.file_name = mesh.file_name;
    spec.referred = Some(mesh.referred);
    Ok(Upload { folder: into.folder, spec, digests: Vec::new(), earlier: mesh.earlier, head: mesh.saved.head })
}
