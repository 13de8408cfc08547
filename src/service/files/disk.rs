//! Disk space: how much the folder holds and may hold.
//!
//! Uploads are refused before the disk is full, so that accepted jobs can end: results and the store of jobs use the
//! rest.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::names::{RESULTS, UPLOADS};
use crate::error::{Error, Kind, Result};
use crate::service::blobs::folder::{bytes, each_below};
use crate::service::private;

/// Bytes that stay free for the store of jobs, whose log grows with every change before it is written over.
pub(super) const STORE_ROOM: u64 = 8 << 20;

/// What the folder may hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::service) struct DiskLimits {
    /// Bytes of everything in the folder above which uploads are refused.
    pub max_bytes: Option<u64>,
    /// Free bytes of the file system below which uploads are refused.
    pub min_free_bytes: u64,
}

impl DiskLimits {
    /// Refuses a reserve that the disk of a folder never has: no upload would be taken.
    pub fn check(&self, folder: &Path) -> Result<()> {
        match total_bytes(folder) {
            Some(total) if (1..=self.min_free_bytes).contains(&total) => Err(Error::parameter(format_args!(
                "no upload would ever be taken with this --min-free-bytes: give less than the {total} bytes that the \
                 disk of {} has in all, or take a larger disk; it is {}",
                folder.display(),
                self.min_free_bytes
            ))),
            _ => Ok(()),
        }
    }
}

/// Part of the disk that the file system may take for itself.
const METADATA: u64 = 20;

/// Room on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct State {
    /// Bytes that may still be written.
    pub free: u64,
    /// Bytes of files that are not the service's.
    pub foreign: u64,
}

/// The room in a folder.
#[derive(Debug)]
pub(super) struct Disk {
    root: PathBuf,
    limits: DiskLimits,
    /// Bytes of all blobs.
    blobs: AtomicU64,
    /// Bytes of the store of jobs that it will use again.
    free_in_store: AtomicU64,
}

impl Disk {
    /// Counts the blobs. On the way it takes the access of group and others away from files of earlier releases.
    pub fn new(root: PathBuf, limits: DiskLimits) -> Self {
        let (mut blobs, mut open) = (0, None);
        for folder in [UPLOADS, RESULTS] {
            each_below(&root.join(folder), |path, found| {
                blobs += bytes(found);
                if let Err(error) = private::tighten_found(path, found) {
                    open = Some((path.to_owned(), error));
                }
            });
        }
        if let Some((path, error)) = open {
            let path = path.display();
            tracing::warn!(%path, %error, "other users may read files of jobs: this mode, for one, cannot be changed");
        }
        Self { root, limits, blobs: AtomicU64::new(blobs), free_in_store: AtomicU64::new(0) }
    }

    /// Refuses `more` bytes without room for them beside what is `taken`: promised, but not written yet.
    /// [`Kind::TooLarge`] when there would be none on an empty disk either.
    pub fn check(&self, more: u64, taken: u64) -> Result<()> {
        if more > self.holds() {
            return Err(Error::too_large(format_args!(
                "the upload is larger than the storage of this service is in all; send a smaller mesh, or ask for \
                 larger storage; bytes: {more}"
            )));
        }
        // free space is for the operator (`/metrics`), not for clients
        let refuse = |what: &str, limit: u64| {
            Err(Error::new(
                Kind::InsufficientStorage,
                format_args!(
                    "{what}, so uploads are refused, what accepted jobs will need included; delete jobs, or try again \
                     later; the setting in bytes: {limit}"
                ),
            ))
        };
        let more = more.saturating_add(taken);
        if let Some(most) = self.limits.max_bytes.filter(|most| self.used().saturating_add(more) > *most) {
            return refuse("the data folder is at its limit (--max-disk-bytes)", most);
        }
        match self.free() {
            Some(free) if free.saturating_sub(more) < self.reserve() => {
                refuse("the disk has less room than its reserve (--min-free-bytes)", self.reserve())
            }
            Some(_) | None => Ok(()),
        }
    }

    /// Refuses a job whose upload and expected result have no room together in an empty folder either, beside what is
    /// always `taken`.
    pub fn check_job(&self, upload: u64, result: u64, taken: u64) -> Result<()> {
        let (needs, holds) = (upload.saturating_add(result), self.holds().saturating_sub(taken));
        if needs <= holds {
            return Ok(());
        }
        Err(Error::too_large(format_args!(
            "the upload and the result that is expected of it are larger than the storage of this service, which holds \
             {holds} bytes; send a smaller mesh, or ask for larger storage; bytes: {needs}"
        )))
    }

    /// Bytes that the folder may hold at most.
    fn holds(&self) -> u64 {
        let disk = total_bytes(&self.root).filter(|total| *total > 0).unwrap_or(u64::MAX);
        disk.saturating_sub(self.reserve()).min(self.limits.max_bytes.unwrap_or(u64::MAX))
    }

    /// Bytes that this process may still write; none where that cannot be told.
    pub fn free(&self) -> Option<u64> {
        space(&self.root).map(|(free, _, _)| free)
    }

    /// Free bytes, and bytes of files of others; `more` are the bytes of the service's files other than blobs.
    pub fn state(&self, more: u64) -> State {
        let (free, total, taken) = space(&self.root).unwrap_or((u64::MAX, 0, 0));
        let foreign = taken.saturating_sub(self.used().saturating_add(more)).saturating_sub(total / METADATA);
        State { free, foreign }
    }

    /// Free bytes beyond the reserve and what is `taken`.
    pub fn spare(&self, taken: u64) -> u64 {
        self.free().unwrap_or(u64::MAX).saturating_sub(taken.saturating_add(self.reserve()))
    }

    /// Free bytes that no upload takes.
    fn reserve(&self) -> u64 {
        self.limits.min_free_bytes.max(STORE_ROOM)
    }

    /// Counts written bytes.
    pub fn written(&self, bytes: u64) {
        self.blobs.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Counts removed bytes.
    pub fn removed(&self, bytes: u64) {
        let less = |blobs: u64| Some(blobs.saturating_sub(bytes));
        let _ = self.blobs.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
    }

    /// Sets the free bytes of the store of jobs.
    pub fn free_in_store(&self, bytes: u64) {
        self.free_in_store.store(bytes, Ordering::Relaxed);
    }

    /// Bytes of the blobs and of what is in the store of jobs.
    pub fn used(&self) -> u64 {
        let database: u64 = ["jobs.sqlite3", "jobs.sqlite3-wal"]
            .iter()
            .filter_map(|name| Some(self.root.join(name).metadata().ok()?.len()))
            .sum();
        (self.blobs.load(Ordering::Relaxed) + database).saturating_sub(self.free_in_store.load(Ordering::Relaxed))
    }
}

/// Bytes of the file system of a folder: those that this process may still write, all, and those that are taken. None
/// where that cannot be told.
#[cfg(unix)]
fn space(folder: &Path) -> Option<(u64, u64, u64)> {
    let found = rustix::fs::statvfs(folder).ok()?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    Some((bytes(found.f_bavail), bytes(found.f_blocks), bytes(found.f_blocks.saturating_sub(found.f_bfree))))
}

/// Bytes of the file system of a folder; none where that cannot be told.
#[cfg(not(unix))]
fn space(_: &Path) -> Option<(u64, u64, u64)> {
    None
}

/// Bytes of the file system of a folder; none where that cannot be told.
pub(super) fn total_bytes(folder: &Path) -> Option<u64> {
    space(folder).map(|(_, total, _)| total)
}
