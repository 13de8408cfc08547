//! Files of jobs that the store does not know when the service starts: moved aside, and removed after a while.
//!
//! A store that was lost, or restored from an old copy, knows fewer jobs than there are files. Removing these would
//! make the loss final.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use object_store::path::Path as BlobPath;

use super::ballast::BALLAST;
use super::folder::Files;
use super::names::{ASIDE, Folder, MESH, RESULTS, UPLOADS};
use super::root;
use crate::error::{Error, Kind, Result};
use crate::service::store::JobId;

/// Time after which it is emptied.
const KEPT: Duration = Duration::from_secs(7 * 86_400);

impl Files {
    /// Checks, before the store of jobs is opened, that it is there if a service worked in the folder before: it left
    /// files of jobs or, where all jobs were small, its ballast. With `forget` the files of a store that
    /// is missing or empty are moved aside instead.
    pub async fn check_store(&self, forget: bool) -> Result<()> {
        if self.database().metadata().is_ok_and(|found| found.len() > 0) {
            return Ok(());
        }
        let jobs = match self.is_shared() {
            // whatever lies elsewhere, it stays
            true => 0,
            false => self.jobs_in(UPLOADS).await?.len() + self.jobs_in(RESULTS).await?.len(),
        };
        let was_used = jobs > 0 || self.root.path().join(BALLAST).exists();
        match (was_used, forget) {
            (false, _) => Ok(()),
            (true, false) => Err(self.lost("is missing or empty", jobs)),
            (true, true) => self.move_all_aside().await,
        }
    }

    /// Checks a store of jobs that never knew a job: there are no results then. With `forget` they are moved aside
    /// instead.
    pub async fn check_unused_store(&self, forget: bool) -> Result<()> {
        if self.is_shared() {
            return Ok(());
        }
        match (self.jobs_in(RESULTS).await?.len(), forget) {
            (0, _) => Ok(()),
            (jobs, false) => Err(self.lost("is new", jobs)),
            (_, true) => self.move_all_aside().await,
        }
    }

    fn lost(&self, what: &str, jobs: usize) -> Error {
        let folder = self.root.path().display();
        let (others, moved) = match jobs {
            0 => ("a service has worked in the data folder".to_owned(), "begins with an empty store".to_owned()),
            _ => (
                format!("the data folder holds files of {jobs} job{}", if jobs == 1 { "" } else { "s" }),
                format!("moves these files to {folder}/{ASIDE}"),
            ),
        };
        Error::new(
            Kind::Conflict,
            format_args!(
                "the store of jobs ({}) {what}, but {others}: put the store back, from a backup for instance, or start \
                 once with --forget-lost-jobs, which {moved}: {folder}",
                root::STORE[0]
            ),
        )
    }

    /// Moves the files of all jobs aside. The store stays where it is.
    async fn move_all_aside(&self) -> Result<()> {
        if self.is_shared() {
            return Ok(());
        }
        for id in self.jobs_in(UPLOADS).await? {
            self.move_aside(Folder::Upload(id)).await?;
        }
        for id in self.jobs_in(RESULTS).await? {
            self.move_aside(Folder::Results(id)).await?;
        }
        Ok(())
    }

    /// Moves the upload of a job aside that the store does not know. One that never became whole is removed.
    pub(super) async fn move_upload_aside(&self, id: JobId) -> Result<()> {
        let folder = Folder::Upload(id);
        let is_whole = self.names_in(&folder.path()).await?.iter().any(|name| name == MESH);
        if is_whole {
            return self.move_aside(folder).await;
        }
        self.remove_upload(id).await;
        Ok(())
    }

    /// Moves blobs aside.
    pub(super) async fn move_aside(&self, folder: Folder) -> Result<()> {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let from = folder.path();
        let to: BlobPath = aside(&seconds.to_string()).parts().chain(from.parts()).collect();
        tracing::warn!(%from, %to, "no job is known for these files: they are moved aside");
        self.blobs.rename(&from, &to).await
    }

    /// Removes what was moved aside long before `now`.
    pub async fn empty_aside(&self, now: SystemTime) -> Result<()> {
        if self.is_shared() {
            return Ok(());
        }
        for name in self.names_in(&BlobPath::from(ASIDE)).await? {
            let Ok(seconds) = name.parse() else { continue };
            if UNIX_EPOCH + Duration::from_secs(seconds) + KEPT < now {
                self.remove_below(&aside(&name)).await;
            }
        }
        Ok(())
    }
}

/// Where what is moved aside at a time lies.
fn aside(time: &str) -> BlobPath {
    BlobPath::from_iter([ASIDE, time])
}
