//! Forgetting a job and its files, also when the disk is full.
//!
//! The job goes first, because files without a job are found and removed later. To forget it the store writes, so a
//! full disk is helped in two steps: the ballast is given up, and then the files of the job go first.

use std::sync::Arc;

use super::files::Files;
use super::store::{Deletion, JobId, JobStore};
use crate::error::{Kind, Result};

/// Deletes an ended job and its files.
pub(super) async fn delete(files: &Arc<Files>, store: &dyn JobStore, id: JobId) -> Result<Deletion> {
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

fn is_full(outcome: &Result<Deletion>) -> bool {
    outcome.as_ref().is_err_and(|error| error.kind == Kind::InsufficientStorage)
}
