//! Where the blobs of a job are found: small ones with the job in the store, others in files.

use object_store::GetRange;
use tesserae_mesh::error::{Error, Kind, Result};

use crate::blobs::Blob;
use crate::files::{Files, Folder, MESH};
use crate::store::{Job, Store};

pub(crate) async fn upload(
    files: &Files,
    store: &Store,
    job: &Job,
    name: &str,
    range: Option<GetRange>,
) -> Result<Blob> {
    if let Some(referred) = job.spec.referred.as_ref().filter(|_| name == MESH) {
        return files.read_referred(&job.spec.tenant, referred, range).await;
    }
    if job.spec.is_small {
        return small(files, store, job, name, range).await;
    }
    files.read(Folder::Upload(job.id), name, range).await
}

/// A blob of the result of a job, or a range of it. [`Kind::NotFound`] for a job without one.
pub(crate) async fn result(
    files: &Files,
    store: &Store,
    job: &Job,
    name: &str,
    range: Option<GetRange>,
) -> Result<Blob> {
    match &job.summary {
        Some(summary) if summary.is_small => small(files, store, job, name, range).await,
        _ => files.read(Folder::Result(job.id, job.attempt), name, range).await,
    }
}

async fn small(files: &Files, store: &Store, job: &Job, name: &str, range: Option<GetRange>) -> Result<Blob> {
    let bytes = store.blob(job.id, name).await?;
    let bytes = bytes.ok_or_else(|| Error::new(Kind::NotFound, "the file is gone: its job was deleted"))?;
    files.held(&bytes, range)
}
