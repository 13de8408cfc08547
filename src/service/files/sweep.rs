//! Sweeping: what no job knows of goes, as after a crash.

use std::path::Path;

use object_store::path::Path as BlobPath;

use super::folder::{Files, Folder};
use crate::error::Result;
use crate::service::store::{Job, JobId, Queue, State};

impl Files {
    /// Removes uploads of jobs that were never accepted, or have ended and are not [kept](Job::keeps_upload) for a
    /// retry, and results of attempts that did not make it. Uploads that are coming in stay. Returns how many folders
    /// went.
    pub async fn sweep(&self, store: &dyn Queue) -> Result<usize> {
        self.sweep_all(store, false).await
    }

    /// The same when the service starts: what belongs to no job of the store is moved aside, because the store may be
    /// an older copy.
    pub async fn sweep_at_start(&self, store: &dyn Queue) -> Result<usize> {
        self.sweep_all(store, true).await
    }

    async fn sweep_all(&self, store: &dyn Queue, moves_aside: bool) -> Result<usize> {
        let mut removed = 0;
        for id in self.jobs_in("uploads").await? {
            // looked at before the store, which knows an accepted one before it stops coming in
            let is_coming_in = self.lock_incoming().contains(&id);
            match store.get(id).await? {
                _ if is_coming_in => continue,
                Some(job) if !job.state.is_ended() || job.keeps_upload() => continue,
                None if moves_aside => self.move_upload_aside(id).await?,
                _ => self.remove_upload(id).await,
            }
            removed += 1;
        }
        for id in self.jobs_in("results").await? {
            removed += match store.get(id).await? {
                None if moves_aside => {
                    self.move_aside(Path::new("results").join(id.to_string())).await?;
                    1
                }
                None => {
                    self.remove(id).await;
                    1
                }
                Some(job) => self.sweep_attempts(&job).await?,
            };
        }
        Ok(removed)
    }

    /// Removes what attempts left that are neither running nor the one that succeeded.
    async fn sweep_attempts(&self, job: &Job) -> Result<usize> {
        let keeps_last = matches!(job.state, State::Running | State::Succeeded);
        let mut removed = 0;
        for name in self.names_in(&format!("results/{}", job.id)).await? {
            let Ok(attempt) = name.parse() else { continue };
            if !(keeps_last && attempt == job.attempt) {
                self.remove_folder(Folder::Result(job.id, attempt).path()).await;
                removed += 1;
            }
        }
        if !keeps_last {
            // empty by now
            let _ = tokio::fs::remove_dir(self.root.path().join(format!("results/{}", job.id))).await;
        }
        Ok(removed)
    }

    /// The jobs that have a folder. What has another name is not the service's.
    pub(super) async fn jobs_in(&self, folder: &str) -> Result<Vec<JobId>> {
        Ok(self.names_in(folder).await?.iter().filter_map(|name| name.parse().ok()).collect())
    }

    async fn names_in(&self, folder: &str) -> Result<Vec<String>> {
        self.blobs.names(&BlobPath::from(folder)).await
    }
}
