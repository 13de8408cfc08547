//! Sweeping: what no job knows of goes, as after a crash.
//!
//! A place that is shared holds uploads that come in at another process, which the store does not know yet, and which
//! this process cannot tell from those that a killed process left. There, what belongs to no job goes when its newest
//! blob is a day old by the clock of the place.

use std::time::{Duration, SystemTime};

use object_store::path::Path as BlobPath;

use super::folder::Files;
use super::names::{Folder, RESULTS, UPLOADS};
use crate::error::Result;
use crate::service::store::{Job, JobId, Queue, State};

/// Age at which blobs without a job go from a place that is shared. An upload that takes longer is lost.
const OLD: Duration = Duration::from_secs(86_400);

impl Files {
    /// Removes uploads of jobs that were never accepted, or have ended and are not [kept](Job::keeps_upload) for a
    /// retry, and results of attempts that did not make it. Uploads that are coming in stay. Returns how many folders
    /// went.
    pub async fn sweep(&self, store: &dyn Queue) -> Result<usize> {
        self.sweep_all(store, false).await
    }

    /// The same when the service starts: what belongs to no job of the store is moved aside, because the store may be
    /// an older copy. A place that is shared is not swept then.
    pub async fn sweep_at_start(&self, store: &dyn Queue) -> Result<usize> {
        match self.is_shared() {
            true => Ok(0),
            false => self.sweep_all(store, true).await,
        }
    }

    async fn sweep_all(&self, store: &dyn Queue, moves_aside: bool) -> Result<usize> {
        let mut removed = 0;
        let old = match self.is_shared() {
            true => self.blobs.probe().await?.checked_sub(OLD),
            false => None,
        };
        for id in self.jobs_in(UPLOADS).await? {
            // looked at before the store, which knows an accepted one before it stops coming in
            let is_coming_in = self.lock_incoming().contains(&id);
            match store.get(id).await? {
                _ if is_coming_in => continue,
                Some(job) if !job.state.is_ended() || job.keeps_upload() => continue,
                None if moves_aside => self.move_upload_aside(id).await?,
                None if self.is_young(Folder::Upload(id), old).await? => continue,
                _ => self.remove_upload(id).await,
            }
            removed += 1;
        }
        for id in self.jobs_in(RESULTS).await? {
            // listed before the store is read, which knows an attempt before it has files
            let attempts = self.names_in(&Folder::Results(id).path()).await?;
            match store.get(id).await? {
                None if moves_aside => self.move_aside(Folder::Results(id)).await?,
                None if self.is_young(Folder::Results(id), old).await? => continue,
                None => self.remove(id).await,
                Some(job) => {
                    removed += self.sweep_attempts(&job, &attempts).await;
                    continue;
                }
            }
            removed += 1;
        }
        Ok(removed)
    }

    /// Whether there are blobs in a folder that were stored after a time.
    async fn is_young(&self, folder: Folder, old: Option<SystemTime>) -> Result<bool> {
        let Some(old) = old else { return Ok(false) };
        Ok(self.blobs.newest(&folder.path()).await?.is_some_and(|newest| newest > old))
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
        let names = self.names_in(&BlobPath::from(folder)).await?;
        Ok(names.iter().filter_map(|name| name.parse().ok()).collect())
    }

    pub(super) async fn names_in(&self, path: &BlobPath) -> Result<Vec<String>> {
        self.blobs.names(path).await
    }
}
