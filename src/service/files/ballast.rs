//! Ballast: two files of no meaning in the data folder, made again when there is room.
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

use crate::ops::private;

pub(super) const BALLAST: &str = "ballast";

pub(super) const LAST: &str = "ballast.last";

/// Bytes of the ballast, at most: a few transactions of the store of jobs.
const MOST: u64 = 16 << 20;

const PART: u64 = 16;

const PART_OF_LAST: u64 = 4;

#[derive(Debug)]
pub(super) struct Ballast {
    folder: PathBuf,
    size: u64,
}

impl Ballast {
    /// That of a folder on a disk of so many bytes, as far as is known. With `is_kept` false there is none: a temporary
    /// folder goes with the process.
    pub fn new(folder: &Path, disk: Option<u64>, is_kept: bool) -> Self {
        let most = disk.map_or(MOST, |bytes| MOST.min(bytes / PART));
        Self { folder: folder.to_owned(), size: if is_kept { most } else { 0 } }
    }

    /// Makes the files that are not there, when `spare` bytes are more than they take. Blocks.
    pub fn make(&self, spare: impl Fn() -> u64) -> io::Result<()> {
        for (name, size) in [(LAST, self.size / PART_OF_LAST), (BALLAST, self.size)] {
            let path = self.folder.join(name);
            let there = path.metadata().map_or(0, |found| found.len());
            if there >= size || spare() <= size {
                continue;
            }
            let made = private::options()
                .open(&path)
                .and_then(|mut file| io::copy(&mut io::repeat(0).take(size), &mut file).map(drop));
            made.inspect_err(|_| _ = std::fs::remove_file(&path))?;
        }
        Ok(())
    }

    /// Removes one of the files; whether it was there. Blocks.
    pub fn give_up(&self, name: &str) -> bool {
        std::fs::remove_file(self.folder.join(name)).is_ok()
    }
}
