//! Files of jobs that the store does not know when the service starts: moved aside, and removed after a while.
//!
//! A store that was lost, or restored from an old copy, knows fewer jobs than there are files. Removing these would
//! make the loss final.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::ballast::BALLAST;
use super::failure::{blocking, cannot_make};
use super::folder::{Files, Folder};
use super::{private, root};
use crate::error::{Error, Kind, Result};
use crate::service::store::JobId;

/// Name of the folder.
const ASIDE: &str = "aside";

/// Time after which it is emptied.
const KEPT: Duration = Duration::from_secs(7 * 86_400);

impl Files {
    /// Checks, before the store of jobs is opened, that it is there if a service worked in the folder before: it left
    /// files of jobs or, where all jobs were small, its clock or its ballast. With `forget` the files of a store that
    /// is missing or empty are moved aside instead.
    pub async fn check_store(&self, forget: bool) -> Result<()> {
        let Some(database) = self.database() else { return Ok(()) };
        if database.metadata().is_ok_and(|found| found.len() > 0) {
            return Ok(());
        }
        let jobs = self.jobs_in("uploads").await?.len() + self.jobs_in("results").await?.len();
        let was_used = jobs > 0 || [root::CLOCK, BALLAST].iter().any(|name| self.root.path().join(name).exists());
        match (was_used, forget) {
            (false, _) => Ok(()),
            (true, false) => Err(self.lost("is missing or empty", jobs)),
            (true, true) => self.move_all_aside().await,
        }
    }

    /// Checks a store of jobs that never knew a job: there are no results then. With `forget` they are moved aside
    /// instead.
    pub async fn check_unused_store(&self, forget: bool) -> Result<()> {
        match (self.jobs_in("results").await?.len(), forget) {
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
        for id in self.jobs_in("uploads").await? {
            self.move_aside(Folder::Upload(id).path()).await?;
        }
        for id in self.jobs_in("results").await? {
            self.move_aside(Path::new("results").join(id.to_string())).await?;
        }
        Ok(())
    }

    /// Moves the upload of a job aside that the store does not know. One that never became whole is removed.
    pub(super) async fn move_upload_aside(&self, id: JobId) -> Result<()> {
        let folder = Folder::Upload(id).path();
        match self.root.path().join(&folder).join(super::MESH).exists() {
            true => self.move_aside(folder).await,
            false => {
                self.remove_folder(folder).await;
                Ok(())
            }
        }
    }

    /// Moves a folder below the root aside.
    pub(super) async fn move_aside(&self, folder: PathBuf) -> Result<()> {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let from = self.root.path().join(&folder);
        let to = self.root.path().join(ASIDE).join(seconds.to_string()).join(&folder);
        blocking(move || {
            let moved = || {
                private::make_folder(to.parent().unwrap_or(&to))?;
                std::fs::rename(&from, &to)
            };
            let done = moved().map_err(|error| cannot_make(&from, error));
            tracing::warn!(from = %from.display(), to = %to.display(), "no job is known for these files: moved aside");
            done
        })
        .await?
    }

    /// Removes what was moved aside long before `now`.
    pub async fn empty_aside(&self, now: SystemTime) -> Result<()> {
        let path = self.root.path().join(ASIDE);
        let names = blocking(move || names_if_there(&path)).await?;
        for name in names {
            let Ok(seconds) = name.parse() else { continue };
            if UNIX_EPOCH + Duration::from_secs(seconds) + KEPT < now {
                self.remove_folder(Path::new(ASIDE).join(name)).await;
            }
        }
        Ok(())
    }
}

fn names_if_there(folder: &Path) -> Vec<String> {
    let read = || io::Result::Ok(std::fs::read_dir(folder)?.flatten().map(|entry| entry.file_name()));
    read().map(|names| names.filter_map(|name| name.into_string().ok()).collect()).unwrap_or_default()
}
