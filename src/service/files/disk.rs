//! Room on the disk of the data folder.
//!
//! An upload is accepted while the disk has room for it, for the results of all uploads that are there, and for the
//! reserve: what the store of jobs grows by. A job whose results find no room writes them again (`pipeline::bounds`).
//!
//! Ballast is two files of no meaning in the data folder, made again when there is room:
//!
//! | file | removed |
//! |---|---|
//! | [`BALLAST`] | when a full disk stops deletions |
//! | [`LAST`] | when the service starts on a full disk, and the other one is gone |
//!
//! To forget a job, the store of jobs writes first, and to be opened it writes files beside its own. On a full disk it
//! cannot, so nothing that would make room could begin.

use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;
use tesserae_mesh::error::{Error, Kind, Result};

use super::root::UPLOADS;
use crate::blobs::folder::size;
use crate::ops::private;

pub(super) const BALLAST: &str = "ballast";
pub(super) const LAST: &str = "ballast.last";

/// Least reserve: the log of the store of jobs grows with every change before it is written over.
pub(super) const STORE_ROOM: u64 = 8 << 20;

/// Bytes that results may take for each byte of an upload. A face takes 12 to 50 bytes of an upload, 4 of labels, 24 of
/// a kept mesh, and 132 of a hierarchy of `pml`, whose OBJ has about 35. A compressed image takes more.
const RESULTS: u64 = 4;

pub(super) fn check_reserve(folder: &Path, reserve: u64) -> Result<()> {
    match total_bytes(folder) {
        Some(total) if (1..=reserve).contains(&total) => Err(Error::parameter(format_args!(
            "no upload would ever be taken with this --min-free-bytes: give less than the {total} bytes that the disk \
             of {} has in all, or take a larger disk; it is {reserve}",
            folder.display(),
        ))),
        _ => Ok(()),
    }
}

#[derive(Debug)]
pub(super) struct Disk {
    root: PathBuf,
    reserve: u64,
    has_uploads: bool,
    /// Bytes of the files of uploads, those that are coming in included.
    uploads: AtomicU64,
    /// Bytes of the ballast; 0 for a temporary folder, which goes with the process.
    ballast: u64,
}

impl Disk {
    pub fn new(root: PathBuf, is_kept: bool, reserve: u64, has_uploads: bool) -> Self {
        let uploads = AtomicU64::new(size(&root.join(UPLOADS)));
        // at most a few transactions of the store of jobs, and a small part of the disk
        let ballast = if is_kept { (16 << 20).min(total_bytes(&root).unwrap_or(u64::MAX) / 16) } else { 0 };
        Self { root, reserve: reserve.max(STORE_ROOM), has_uploads, uploads, ballast }
    }

    /// Refuses `more` bytes of an upload of which `before` were written, without room for them and their results.
    /// [`Kind::TooLarge`] when there would be none on an empty disk either.
    pub fn check(&self, more: u64, before: u64) -> Result<()> {
        let [more, before] = [more, before].map(|bytes| if self.has_uploads { bytes } else { 0 });
        let with_results = |bytes: u64| more.saturating_add(bytes.saturating_mul(RESULTS));
        let needs = with_results(before.saturating_add(more));
        let holds = total_bytes(&self.root).unwrap_or(u64::MAX).saturating_sub(self.reserve);
        if needs > holds {
            return Err(Error::too_large(format_args!(
                "the upload and its results are larger than the storage of this service is in all; send a smaller \
                 mesh, or ask for larger storage; bytes: {needs}"
            )));
        }
        // free space is for the operator (`/metrics`), not for clients; what was written before is among the uploads
        if self.free().is_some_and(|free| free < self.taken().saturating_add(with_results(more))) {
            let why = format_args!(
                "the disk has less room than its reserve (--min-free-bytes), what accepted jobs will need included, so \
                 uploads are refused; delete jobs, or try again later; the reserve in bytes: {}",
                self.reserve
            );
            return Err(Error::new(Kind::InsufficientStorage, why));
        }
        Ok(())
    }

    pub fn free(&self) -> Option<u64> {
        space(&self.root).map(|(free, _)| free)
    }

    /// Free bytes beyond the reserve and what accepted jobs will need.
    pub fn spare(&self) -> u64 {
        self.free().unwrap_or(u64::MAX).saturating_sub(self.taken())
    }

    fn taken(&self) -> u64 {
        self.uploads.load(Ordering::Relaxed).saturating_mul(RESULTS).saturating_add(self.reserve)
    }

    pub fn uploaded(&self, bytes: u64) {
        if self.has_uploads {
            self.uploads.fetch_add(bytes, Ordering::Relaxed);
        }
    }

    pub fn removed(&self, bytes: u64) {
        let less = |uploads: u64| Some(uploads.saturating_sub(bytes));
        let _ = self.uploads.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
    }

    /// Makes the ballast that is not there, when there is room to spare. Blocks.
    pub fn make_ballast(&self) -> io::Result<()> {
        for (name, size) in [(LAST, self.ballast / 4), (BALLAST, self.ballast)] {
            let path = self.root.join(name);
            let there = path.metadata().map_or(0, |found| found.len());
            if there >= size || self.spare() <= size {
                continue;
            }
            let take = |mut file| match fallocate(&file, FallocateFlags::empty(), 0, size) {
                // some file systems cannot
                Err(Errno::OPNOTSUPP | Errno::NOSYS) => io::copy(&mut io::repeat(0).take(size), &mut file).map(drop),
                taken => taken.map_err(io::Error::from),
            };
            private::options().open(&path).and_then(take).inspect_err(|_| _ = std::fs::remove_file(&path))?;
        }
        Ok(())
    }
}

/// Bytes of the file system of a folder, if known: those that this process may still write, and all.
fn space(folder: &Path) -> Option<(u64, u64)> {
    let found = rustix::fs::statvfs(folder).ok()?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    Some((bytes(found.f_bavail), bytes(found.f_blocks)))
}

pub(super) fn total_bytes(folder: &Path) -> Option<u64> {
    space(folder).map(|(_, total)| total).filter(|total| *total > 0)
}
