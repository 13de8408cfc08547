//! The blobs of a job, of which small ones lie with it in the store and others in files: where they are, how they go.
//!
//! The store deletes the job before its files are removed, because a sweep finds files without a job later. On a full
//! disk, where it cannot write, it tries again after the ballast is removed, and again after the files of the job are.

use object_store::GetRange;
use tesserae_mesh::error::{Error, Kind, Result};

use crate::blobs::Blob;
use crate::files::{Files, Folder, MESH};
use crate::store::{Deletion, Job, JobId, Store};

pub async fn upload(files: &Files, store: &Store, job: &Job, name: &str, range: Option<GetRange>) -> Result<Blob> {
    if let Some(referred) = job.spec.referred.as_ref().filter(|_| name == MESH) {
        return files.read_referred(&job.spec.tenant, referred, range).await;
    }
    if job.spec.is_small {
        return small(files, store, job, name, range).await;
    }
    files.read(Folder::Upload(job.id), name, range).await
}

/// A blob of the result of a job, or a range of it. [`Kind::NotFound`] for a job without one.
pub async fn result(files: &Files, store: &Store, job: &Job, name: &str, range: Option<GetRange>) -> Result<Blob> {
    match &job.summary {
        Some(summary) if summary.is_small => small(files, store, job, name, range).await,
        _ => files.read(Folder::Result(job.id, job.attempt), name, range).await,
    }
}

async fn small(files: &Files, store: &Store, job: &Job, name: &str, range: Option<GetRange>) -> Result<Blob> {
    let bytes = store.blob(job.id, name).await?;
    let bytes = bytes.ok_or_else(|| Error::not_found("the file is gone: its job was deleted"))?;
    files.held(&bytes, range)
}

pub async fn delete(files: &Files, store: &Store, id: JobId) -> Result<Deletion> {
    let mut outcome = store.delete(id).await;
    if is_full(&outcome) && files.give_up_ballast().await {
        outcome = store.delete(id).await;
    }
    if is_full(&outcome) && store.get(id).await?.is_some_and(|job| job.state.is_ended()) {
        files.remove(id).await;
        outcome = store.delete(id).await;
    }
    if outcome == Ok(Deletion::Deleted) {
        files.remove(id).await;
    }
    outcome
}

/// Cancels a job, as [`Store::cancel`] does.
pub async fn cancel(files: &Files, store: &Store, id: JobId) -> Result<Option<Job>> {
    let mut outcome = store.cancel(id).await;
    if is_full(&outcome) && files.give_up_ballast().await {
        outcome = store.cancel(id).await;
    }
    outcome
}

fn is_full<T>(outcome: &Result<T>) -> bool {
    outcome.as_ref().is_err_and(|error| error.kind == Kind::InsufficientStorage)
}
