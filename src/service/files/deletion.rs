//! Cancelling a job, and deleting one with its files, also when the disk is full.
//!
//! The store deletes the job before its files are removed, because a sweep finds files without a job later. To delete a
//! job the store must write. On a full disk there are two more attempts: after the ballast is removed, and after the
//! files of the job are.

use std::sync::Arc;

use tesserae_mesh::error::{Kind, Result};

use crate::files::Files;
use crate::store::{Deletion, Job, JobId, Store};

/// Deletes an ended job and its files.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::faults::{FaultPoint, Faults};
    use crate::store::tests::{RULES, new_job};
    use crate::store::{State, Store};

    #[tokio::test]
    async fn a_job_is_cancelled_on_a_full_disk() {
        let folder = tempfile::tempdir().expect("a folder");
        let faults = Faults::default();
        let files = Arc::new(Files::open(Some(folder.path()), None, 0, faults.clone()).expect("it opens"));
        files.make_ballast();
        let path = files.database();
        let store = Store::open(&path, RULES, faults.clone()).await.expect("a store");
        let job = new_job();
        store.create(job.clone()).await.expect("created");
        faults.arm(FaultPoint::Commit, std::io::ErrorKind::StorageFull, 0, 1);
        let cancelled = cancel(&files, &store, job.id).await.expect("cancelled").expect("there");
        assert_eq!(cancelled.state, State::Cancelled);
        assert!(!folder.path().join("ballast").exists(), "it was given up");
    }
}
