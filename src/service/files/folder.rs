//! The folder of the files: opened, watched and emptied.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use object_store::path::Path as BlobPath;
use parking_lot::Mutex;
use tesserae_mesh::error::{Error, Kind, Result};

use super::disk::{self, BALLAST, Disk, LAST};
use super::root::{CANNOT_REACH, Folder, RESULTS, Root, UPLOADS, cannot_make};
use crate::blobs::Blobs;
use crate::blobs::place::BlobPlace;
use crate::ops::blocking;
use crate::ops::faults::{FaultPoint, Faults};
use crate::ops::private;
use crate::store::JobId;

const SCRATCH: &str = "scratch";
const FOLDERS: [&str; 3] = [UPLOADS, RESULTS, SCRATCH];

#[derive(Debug)]
pub(crate) struct Files {
    pub(super) root: Root,
    pub(super) blobs: Blobs,
    /// Where meshes may lie that no request brings, each with its bucket.
    pub(super) prefixes: Vec<(BlobPlace, Blobs)>,
    /// Where the blobs lie when they are not in the root. Other processes may use them too.
    pub(super) elsewhere: Option<BlobPlace>,
    /// Name of the store that the place of the blobs belongs to.
    pub(super) owner: Option<String>,
    pub(super) disk: Disk,
    /// Uploads in progress; the store has no row for them.
    pub(super) incoming: Mutex<HashSet<JobId>>,
    /// Blobs that could not be written or read for reasons of the disk.
    pub(crate) failures: AtomicU64,
    /// Jobs that repeat what they cannot read or write.
    pub(crate) stuck: AtomicU64,
    /// Folders of jobs that the store does not know, as the last sweep found them.
    pub(crate) unknown: AtomicU64,
    /// Blobs of results that were not what was stored.
    pub(crate) damages: AtomicU64,
    pub(crate) faults: Faults,
}

impl Files {
    /// Takes the folder `data_dir`, which is made if need be, or a temporary one; the blobs lie in it or `elsewhere`. A
    /// folder that another process works in is refused. No upload takes the last `reserve` free bytes.
    pub fn open(data_dir: Option<&Path>, elsewhere: Option<&BlobPlace>, reserve: u64, faults: Faults) -> Result<Self> {
        let root = data_dir.map_or_else(Root::temporary, Root::keep)?;
        // nothing that is to stay lies in a temporary folder then
        let reserve = if elsewhere.is_some() && !root.is_kept() { 0 } else { reserve };
        disk::check_reserve(&root.path, reserve)?;
        for folder in FOLDERS {
            let path = root.path.join(folder);
            private::make_folder(&path).map_err(|error| cannot_make(&path, error))?;
        }
        let here = || Blobs::in_folder(&root.path, root.is_kept()).map_err(|error| cannot_make(&root.path, error));
        let blobs = elsewhere.map_or_else(here, BlobPlace::open)?;
        let disk = Disk::new(root.path.clone(), root.is_kept(), reserve, elsewhere.is_none());
        let files = Self {
            root,
            blobs,
            prefixes: Vec::new(),
            elsewhere: elsewhere.cloned(),
            owner: None,
            disk,
            incoming: Mutex::default(),
            failures: AtomicU64::default(),
            stuck: AtomicU64::default(),
            unknown: AtomicU64::default(),
            damages: AtomicU64::default(),
            faults,
        };
        // the store needs some room to be opened
        let is_full = || files.disk.free().is_some_and(|free| free < disk::STORE_ROOM / 8);
        let gives_up = |name: &&str| std::fs::remove_file(files.root.path.join(name)).is_ok();
        if is_full() && [BALLAST, LAST].iter().any(gives_up) {
            tracing::warn!("the disk is full: the service gives up ballast to start");
        }
        Ok(files)
    }

    pub fn database(&self) -> PathBuf {
        self.root.path.join("jobs.sqlite3")
    }

    pub fn scratch(&self) -> PathBuf {
        self.root.path.join(SCRATCH)
    }

    pub async fn remove_upload(&self, id: JobId) {
        let removed = self.remove_below(&Folder::Upload(id).path()).await;
        self.disk.removed(removed);
    }

    pub async fn remove_result(&self, id: JobId, attempt: u32) {
        self.remove_below(&Folder::Result(id, attempt).path()).await;
    }

    pub async fn remove(&self, id: JobId) {
        self.remove_upload(id).await;
        self.remove_below(&Folder::Results(id).path()).await;
    }

    /// Refuses `more` bytes of an upload, of which `before` were written, without room for them or without the folder.
    pub fn check_room(&self, more: u64, before: u64) -> Result<()> {
        self.check_reachable()?;
        self.disk.check(more, before)
    }

    pub async fn make_ballast(self: &Arc<Self>) {
        let this = Arc::clone(self);
        if let Ok(Err(error)) = blocking(move || this.disk.make_ballast()).await {
            tracing::warn!(%error, "the ballast cannot be made; without it, a full disk may stop deletions");
        }
    }

    /// Gives the ballast up, so that the store can write; whether there was any.
    pub async fn give_up_ballast(&self) -> bool {
        let had_any = tokio::fs::remove_file(self.root.path.join(BALLAST)).await.is_ok();
        if had_any {
            tracing::warn!("the disk is full: the ballast was given up, so that jobs can be forgotten");
        }
        had_any
    }

    /// Counts and logs a blob of a result that is not what was stored; the error of it.
    pub fn damaged(&self, job: JobId, name: &str, why: impl std::fmt::Display) -> Error {
        self.damages.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%job, "the stored {name} is damaged: {why}");
        Error::new(Kind::Damaged, format_args!("the stored {name} is damaged, submit the mesh again: {why}"))
    }

    pub fn free_bytes(&self) -> Option<u64> {
        self.disk.free()
    }

    /// Whether bytes that are free in the store of jobs would be more than an eighth of what uploads may take.
    pub fn is_short_of(&self, free_in_store: u64) -> bool {
        free_in_store > self.disk.spare() / 8
    }

    /// Whether the folder is there and takes a file; says what is wrong. Blocks.
    pub fn probe(&self) -> Result<()> {
        let folder = self.root.path.display();
        let cannot = |error| Error::storage(format_args!("no file can be written in the data folder: {folder}"), error);
        self.faults.hit(FaultPoint::ProbeFolder).map_err(cannot)?;
        self.check_root()?;
        let write = || {
            for folder in FOLDERS.map(|name| self.root.path.join(name)) {
                private::make_folder(&folder)?;
                tempfile::tempfile_in(folder)?;
            }
            let mut file = tempfile::tempfile_in(self.scratch())?;
            io::Write::write_all(&mut file, &[0; 4096])?;
            file.sync_all()
        };
        write().map_err(cannot)
    }

    /// An error when the folder is not the one that was opened any more. It names the folder: for the operator only.
    pub fn check_root(&self) -> Result<()> {
        let folder = self.root.path.display();
        let cannot = |error| Error::unavailable(format_args!("the data folder cannot be used: {folder}: {error}"));
        self.root.check().map_err(cannot)
    }

    /// The same for clients, without the folder's name. The failure is counted, so that the log gets the name.
    pub(super) fn check_reachable(&self) -> Result<()> {
        self.check_root().map_err(|error| {
            self.noted(error);
            Error::unavailable(CANNOT_REACH)
        })
    }

    pub(super) fn noted(&self, error: Error) -> Error {
        if error.is_of_storage() {
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
        error
    }

    /// Removes a temporary folder, and lets another process have one that stays.
    pub async fn close(&self) {
        if let Some(folder) = &self.root.temporary {
            let _ = tokio::fs::remove_dir_all(folder.path()).await;
        } else if let Some(Err(error)) = self.root.lock.as_ref().map(std::fs::File::unlock) {
            tracing::warn!(%error, "the data folder stays locked until the process ends");
        }
    }

    /// Removes all blobs below a path; gives the number of their bytes. What cannot be removed now, a sweep removes.
    async fn remove_below(&self, path: &BlobPath) -> u64 {
        self.blobs.remove(path).await.unwrap_or_else(|error| {
            tracing::warn!("{error}");
            0
        })
    }
}
