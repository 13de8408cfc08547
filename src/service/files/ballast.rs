//! Ballast: a file of no meaning in the data folder, removed when a full disk stops deletions, and made again when
//! there is room.
//!
//! To forget a job, the store of jobs writes first. On a full disk it cannot, so nothing that would make room could
//! begin.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::ops::private;

/// Name of the file.
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
    /// Bytes that it has.
    there: Mutex<u64>,
}

impl Ballast {
    /// That of a folder on a disk of so many bytes, as far as is known. With `is_kept` false there is none: a temporary
    /// folder goes with the process.
    pub fn new(folder: &Path, disk: Option<u64>, is_kept: bool) -> Self {
        let most = disk.map_or(MOST, |bytes| MOST.min(bytes / PART));
        let path = folder.join(BALLAST);
        let there = path.metadata().map_or(0, |metadata| metadata.len());
        Self { path, size: if is_kept { most } else { 0 }, there: Mutex::new(there) }
    }

    /// Makes it, when it is not there and `spare` bytes are more than it takes. Blocks.
    pub fn make(&self, spare: impl FnOnce() -> u64) -> io::Result<()> {
        let mut there = self.lock();
        if *there >= self.size || spare() <= self.size {
            return Ok(());
        }
        let made = private::options().open(&self.path).and_then(|file| allocate(&file, self.size));
        match made {
            Ok(()) => *there = self.size,
            Err(_) => {
                *there = 0;
                let _ = std::fs::remove_file(&self.path);
            }
        }
        made
    }

    /// Removes it; whether there was any. Blocks.
    pub fn give_up(&self) -> bool {
        let mut there = self.lock();
        let was_there = *there > 0 && std::fs::remove_file(&self.path).is_ok();
        *there = 0;
        was_there
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.there.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Takes so many bytes of the disk for a file.
#[cfg(target_os = "linux")]
fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    use rustix::fs::{FallocateFlags, fallocate};
    match fallocate(file, FallocateFlags::empty(), 0, bytes) {
        Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::NOSYS) => write_zeros(file, bytes),
        made => made.map_err(io::Error::from),
    }
}

/// Takes so many bytes of the disk for a file.
#[cfg(not(target_os = "linux"))]
fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    write_zeros(file, bytes)
}

fn write_zeros(file: &File, bytes: u64) -> io::Result<()> {
    let mut zeros = io::Read::take(io::repeat(0), bytes);
    io::copy(&mut zeros, &mut io::BufWriter::with_capacity(1 << 20, file)).map(drop)
}
