//! The place of the blobs: the data folder, or elsewhere (`--blobs`), where other processes may have theirs.
//!
//! A store of jobs belongs to a place, and a place to one store: another store would sweep its files away, and at
//! another place the jobs have no files. So a place keeps the name of its store as a blob, [`OWNER`], which also shows
//! that the store of a data folder was lost. The room of a place elsewhere is not counted: other processes fill it too.

use axum::body::Bytes;
use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Kind, Result};

use super::disk::{BALLAST, LAST};
use super::folder::Files;
use super::root::{CANNOT_REACH, OWNER, RESULTS, UPLOADS};

impl Files {
    pub fn is_shared(&self) -> bool {
        self.elsewhere.is_some()
    }

    /// Checks, before the store of jobs is opened, that it is there if there was one: what is left of its log would go.
    pub fn check_store(&self) -> Result<()> {
        let is_there = self.database().metadata().is_ok_and(|found| found.len() > 0);
        let had_one = [OWNER, BALLAST].iter().any(|name| self.root.path.join(name).exists());
        if had_one && !is_there { Err(self.lost_store()) } else { Ok(()) }
    }

    /// Checks a store of jobs that never knew a job: there are no results then.
    pub async fn check_unused_store(&self) -> Result<()> {
        let is_unused = self.is_shared() || self.jobs_in(RESULTS).await?.is_empty();
        if is_unused { Ok(()) } else { Err(self.lost_store()) }
    }

    fn lost_store(&self) -> Error {
        Error::conflict(format_args!(
            "the store of jobs of this data folder is missing, empty, older than its files, or another one: put it \
             back, from a backup for instance, or, to begin with an empty store, move {UPLOADS}, {RESULTS}, {OWNER}, \
             {BALLAST}, {LAST} and what there is of jobs.sqlite3 out of the data folder: {}",
            self.root.path.display()
        ))
    }

    /// Takes the place of the blobs for a store of this name. A place without an owner becomes that of a new store.
    pub async fn take_place(&mut self, store: &str, has_jobs: bool) -> Result<()> {
        let folder = self.root.path.display();
        let place = self.elsewhere.as_ref().map_or(folder.to_string(), ToString::to_string);
        let conflict = |message: String| Err(Error::conflict(message));
        if self.is_shared() && self.root.path.join(OWNER).exists() {
            return conflict(format!(
                "files of jobs lie in the data folder: move {UPLOADS}, {RESULTS} and {OWNER} from it to {place} while \
                 the service is stopped, or start without --blobs: {folder}"
            ));
        }
        match self.owner().await? {
            Some(owner) if owner == store => {}
            Some(_) if self.is_shared() => {
                return conflict(format!(
                    "another store of jobs has its files here, and each would remove the other's: give every store its \
                     own folder or prefix (--blobs), or remove the file {OWNER} here if that store is gone: {place}"
                ));
            }
            Some(_) => {
                let Error { message, .. } = self.lost_store();
                return conflict(format!("{message}; or, if only the file {OWNER} is wrong, write {store} into it"));
            }
            None if has_jobs => {
                return conflict(format!(
                    "the files of the jobs of this store do not lie here: give --blobs with the place where they lie, \
                     or, if they do, write {store} into a file {OWNER} there: {place}"
                ));
            }
            None => {
                self.blobs.put(&BlobPath::from(OWNER), Bytes::copy_from_slice(store.as_bytes())).await?;
                // of two new stores at one place, the last one has it
                if self.owner().await?.as_deref() != Some(store) {
                    return conflict(format!("another store of jobs takes this place at the same time: {place}"));
                }
            }
        }
        self.owner = Some(store.to_owned());
        Ok(())
    }

    async fn owner(&self) -> Result<Option<String>> {
        match self.blobs.get(&BlobPath::from(OWNER), None).await {
            Ok(found) => Ok(Some(String::from_utf8_lossy(&found.bytes().await?).trim().to_owned())),
            Err(error) if error.kind == Kind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Whether blobs that lie elsewhere lie at the place of this store.
    async fn is_owned(&self) -> Result<bool> {
        Ok(self.elsewhere.is_none() || self.owner.is_none() || self.owner().await? == self.owner)
    }

    /// An error when a blob was written to another place: a folder that is not mounted takes it, too.
    pub(super) async fn check_owned(&self) -> Result<()> {
        match self.is_owned().await {
            Ok(false) => Err(self.noted(Error::unavailable(CANNOT_REACH))),
            checked => checked.map(drop).map_err(|error| self.noted(error)),
        }
    }

    /// Whether blobs that lie elsewhere can be stored and found there; says what is wrong. Without the owner it is
    /// another place: a folder that is not mounted, say.
    pub async fn probe_elsewhere(&self) -> Result<()> {
        let Some(place) = &self.elsewhere else { return Ok(()) };
        let probe = async {
            self.blobs.names(&BlobPath::default()).await?;
            if !self.is_owned().await? {
                return Err(Error::conflict(format_args!("the file {OWNER} is not there, or another one")));
            }
            self.blobs.probe().await
        };
        probe.await.map(drop).map_err(|error| {
            Error::unavailable(format_args!("files of jobs cannot be stored at {place} (--blobs): {error}"))
        })
    }

    /// An error when the place of the blobs is away: each blob looks removed then.
    pub(super) async fn check_place(&self) -> Result<()> {
        self.check_reachable()?;
        if self.is_shared() && self.blobs.names(&BlobPath::default()).await.is_err() {
            return Err(self.noted(Error::unavailable(CANNOT_REACH)));
        }
        Ok(())
    }
}
