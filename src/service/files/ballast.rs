//! Ballast: a file of no meaning in the data folder, removed when a full disk stops deletions, and made again when
//! there is room.
//!
//! To forget a job, the store of jobs writes first. On a full disk it cannot, so nothing that would make room could
//! begin.

use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use crate::ops::private;

pub(super) const BALLAST: &str = "ballast";

/// Bytes of the ballast, at most: a few transactions of the store of jobs.
const MOST: u64 = 16 << 20;

/// Part of the disk that the ballast may take.
const PART: u64 = 16;

#[derive(Debug)]
pub(super) struct Ballast {
    path: PathBuf,
    /// Bytes that it is to have.
    size: u64,
}

impl Ballast {
    /// That of a folder on a disk of so many bytes, as far as is known. With `is_kept` false there is none: a temporary
    /// folder goes with the process.
    pub fn new(folder: &Path, disk: Option<u64>, is_kept: bool) -> Self {
        let most = disk.map_or(MOST, |bytes| MOST.min(bytes / PART));
        Self { path: folder.join(BALLAST), size: if is_kept { most } else { 0 } }
    }

    /// Makes it, when it is not there and `spare` bytes are more than it takes. Blocks.
    pub fn make(&self, spare: impl FnOnce() -> u64) -> io::Result<()> {
        let there = self.path.metadata().map_or(0, |found| found.len());
        if there >= self.size || spare() <= self.size {
            return Ok(());
        }
        let made = private::options()
            .open(&self.path)
            .and_then(|mut file| io::copy(&mut io::repeat(0).take(self.size), &mut file).map(drop));
        made.inspect_err(|_| _ = std::fs::remove_file(&self.path))
    }

    /// Removes it; whether there was any. Blocks.
    pub fn give_up(&self) -> bool {
        std::fs::remove_file(&self.path).is_ok()
    }
}
