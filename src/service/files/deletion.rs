//! Cancelling a job, and deleting one with its files, also when the disk is full.
//!
//! The store deletes the job before its files are removed, because a sweep finds files without a job later. To delete a
//! job the store must write. On a full disk there are two more attempts: after the ballast is removed, and after the
//! files of the job are.

use std::sync::Arc;

use tesserae_mesh::error::{Kind, Result};

use crate::files::Files;
use crate::store::{Deletion, Job, JobId, Store};

pub(crate) async fn delete(files: &Arc<Files>, store: &Store, id: JobId) -> Result<Deletion> {
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
pub(crate) async fn cancel(files: &Arc<Files>, store: &Store, id: JobId) -> Result<Option<Job>> {
    let mut outcome = store.cancel(id).await;
    if is_full(&outcome) && files.give_up_ballast().await {
        outcome = store.cancel(id).await;
    }
    outcome
}

fn is_full<T>(outcome: &Result<T>) -> bool {
    outcome.as_ref().is_err_and(|error| error.kind == Kind::InsufficientStorage)
}
