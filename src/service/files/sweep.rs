//! Sweeping: what no job knows of goes, as after a crash.
//!
//! Files of a job that the store does not know stay for a while: a store that was restored from an older copy knows
//! fewer jobs than there are files, and removing these would make the loss final. An upload that is not whole goes at
//! once.
//!
//! A place that is shared holds uploads that come in at another process, which the store does not know yet, and which
//! this process cannot tell from those that a killed process left. There, what belongs to no job goes when its newest
//! blob is a day old by the clock of the place.

use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use object_store::path::Path as BlobPath;
use tesserae_mesh::error::Result;

use super::folder::Files;
use super::names::{Folder, MESH, RESULTS, UPLOADS};
use crate::store::{Job, JobId, State, Store};

/// Age at which blobs without a job go from a place that is shared. An upload that takes longer is lost.
const OLD: Duration = Duration::from_secs(86_400);

impl Files {
    /// Removes uploads of jobs that were never accepted, or have ended and are not [kept](Job::keeps_upload) for a
    /// retry, and results of attempts that did not make it. Uploads that are coming in stay, and so do files of unknown
    /// jobs that were stored after `old`, all of them when none. Returns how many folders went.
    pub async fn sweep(&self, store: &Store, old: Option<SystemTime>) -> Result<usize> {
        let (mut removed, mut unknown) = (0, 0);
        let old = match self.is_shared() {
            true => self.blobs.probe().await?.checked_sub(OLD),
            false => old,
        };
        for id in self.jobs_in(UPLOADS).await? {
            // looked at before the store, which knows an accepted one before it stops coming in
            let is_coming_in = self.incoming.lock().contains(&id);
            match store.get(id).await? {
                _ if is_coming_in => {}
                Some(job) if !job.state.is_ended() || job.keeps_upload() => {}
                None if self.stays(Folder::Upload(id), old).await? => unknown += 1,
                _ => {
                    self.remove_upload(id).await;
                    removed += 1;
                }
            }
        }
        for id in self.jobs_in(RESULTS).await? {
            // listed before the store is read, which knows an attempt before it has files
            let attempts = self.blobs.names(&Folder::Results(id).path()).await?;
            match store.get(id).await? {
                Some(job) => removed += self.sweep_attempts(&job, &attempts).await,
                None if self.stays(Folder::Results(id), old).await? => unknown += 1,
                None => {
                    self.remove(id).await;
                    removed += 1;
                }
            }
        }
        // at a shared place, most of them are coming in at other processes
        self.unknown.store(if self.is_shared() { 0 } else { unknown }, Ordering::Relaxed);
        Ok(removed)
    }

    /// Whether a folder of a job that the store does not know stays: it has a file that is newer than `old`.
    async fn stays(&self, folder: Folder, old: Option<SystemTime>) -> Result<bool> {
        let is_upload_of_one = matches!(folder, Folder::Upload(_)) && !self.is_shared();
        if is_upload_of_one && !self.blobs.names(&folder.path()).await?.iter().any(|name| name == MESH) {
            return Ok(false);
        }
        let newest = self.blobs.newest(&folder.path()).await?;
        Ok(newest.is_some_and(|newest| old.is_none_or(|old| newest > old)))
    }

    /// Removes what those of some attempts left that are neither running nor the one that succeeded.
    async fn sweep_attempts(&self, job: &Job, attempts: &[String]) -> usize {
        let keeps_last = matches!(job.state, State::Running | State::Succeeded);
        let mut removed = 0;
        for attempt in attempts.iter().filter_map(|name| name.parse().ok()) {
            if !(keeps_last && attempt == job.attempt) {
                self.remove_result(job.id, attempt).await;
                removed += 1;
            }
        }
        removed
    }

    /// The jobs that have a folder. What has another name is not the service's.
    pub(super) async fn jobs_in(&self, folder: &str) -> Result<Vec<JobId>> {
        let names = self.blobs.names(&BlobPath::from(folder)).await?;
        Ok(names.iter().filter_map(|name| name.parse().ok()).collect())
    }
}
