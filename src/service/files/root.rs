//! The data folder: locked by one process, private to its owner, and checked to be the same folder as at the start.
//!
//! A temporary folder has a lock, too: a free lock marks the folder of a process that was killed, which a later process
//! removes.

use std::fs::{File, Metadata, Permissions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::TempDir;
use tesserae_mesh::error::{Error, Kind, Result};

use super::ballast::BALLAST;
use super::failure::cannot_make;
use crate::ops::private;

/// Start of the names of temporary folders.
const PREFIX: &str = "tesserae-jobs-";

/// Name of the lock in either kind of folder.
pub(super) const LOCK: &str = "lock";

/// Name of the file that says where the blobs lie, if elsewhere.
pub(crate) const BLOBS: &str = "blobs";

/// Files of the store of jobs.
pub(super) const STORE: [&str; 3] = ["jobs.sqlite3", "jobs.sqlite3-wal", "jobs.sqlite3-shm"];

#[derive(Debug)]
pub(super) struct Root {
    pub path: PathBuf,
    /// The folder among the system's temporary files that goes with the process; none for `--data-dir`, where
    /// everything stays.
    pub temporary: Option<TempDir>,
    pub lock: File,
    /// The folder when it was taken. It is held open, so that no other one gets its number.
    found: Metadata,
    _open: Option<File>,
}

impl Root {
    /// Takes the folder at `path`, which is made if need be. [`Kind::Conflict`] when another process works in it.
    ///
    /// The mode of a folder that is there already stays, because it may hold more than jobs; what the service keeps in
    /// it is for the owner only in any case.
    pub fn keep(path: &Path) -> Result<Self> {
        private::make_folder(path).map_err(|error| cannot_make(path, error))?;
        let name = path.join(LOCK);
        let mut lock = private::options().open(&name).map_err(|error| cannot_make(&name, error))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder = std::fs::read_to_string(&name).unwrap_or_default();
                return Err(Error::new(
                    Kind::Conflict,
                    format_args!(
                        "another process ({}) works in the data folder; stop it, or give this one another --data-dir: \
                         {}",
                        holder.trim(),
                        path.display()
                    ),
                ));
            }
            Err(TryLockError::Error(error)) => return Err(cannot_make(&name, error)),
        }
        match note_holder(&mut lock) {
            // the number is for messages only
            Err(error) if error.kind() != io::ErrorKind::StorageFull => return Err(cannot_make(&name, error)),
            Ok(()) | Err(_) => {}
        }
        let path = path.canonicalize().map_err(|error| cannot_make(path, error))?;
        if let Some(mode) = private::open_mode(&path) {
            let (folder, mode) = (path.display(), format!("{mode:04o}"));
            tracing::warn!(%folder, mode, "other users may enter the data folder; `chmod 700` takes that away");
        }
        for name in STORE.into_iter().chain([LOCK, BALLAST, BLOBS]) {
            let file = path.join(name);
            private::tighten(&file).map_err(|error| cannot_make(&file, error))?;
        }
        Self::taken(path, lock, None)
    }

    fn taken(path: PathBuf, lock: File, temporary: Option<TempDir>) -> Result<Self> {
        let found = path.metadata().map_err(|error| cannot_make(&path, error))?;
        Ok(Self { _open: File::open(&path).ok(), path, temporary, lock, found })
    }

    /// Makes a temporary folder in `among`, and removes those there whose process was killed.
    pub fn temporary(among: &Path) -> Result<Self> {
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        // a folder of this process has a lock before another of its threads sweeps
        let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let cannot = |error| cannot_make(among, error);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        builder.permissions(Permissions::from_mode(0o700));
        let folder = builder.tempdir_in(among).map_err(cannot)?;
        // Locked before it has its name, so an unlocked `lock` file means that its process has ended.
        let (new, name) = (folder.path().join("lock.new"), folder.path().join(LOCK));
        let lock_it = || {
            let mut lock = private::options().open(&new)?;
            lock.lock()?;
            note_holder(&mut lock)?;
            std::fs::rename(&new, &name)?;
            io::Result::Ok(lock)
        };
        let lock = lock_it().map_err(cannot)?;
        sweep_temporary(among, folder.path());
        Self::taken(folder.path().to_owned(), lock, Some(folder))
    }

    /// Whether the folder outlasts the process.
    pub fn is_kept(&self) -> bool {
        self.temporary.is_none()
    }

    /// Whether the folder is still the one that was opened: not removed, unmounted, or mounted over.
    pub fn check(&self) -> io::Result<()> {
        match same_file(&self.path.metadata()?, &self.found) {
            true => Ok(()),
            false => Err(io::Error::other("it was replaced by another")),
        }
    }
}

/// Writes the number of this process into its lock.
fn note_holder(lock: &mut File) -> io::Result<()> {
    lock.set_len(0)?;
    lock.write_all(format!("{}\n", std::process::id()).as_bytes())
}

/// Removes temporary folders of processes that were killed: those with a lock that is free. Another user's folders
/// stay.
fn sweep_temporary(among: &Path, own: &Path) {
    for entry in std::fs::read_dir(among).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_one = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX)) && path != own;
        if !is_one || !is_folder_of_same_owner(&path, own) {
            continue;
        }
        if File::options().write(true).open(path.join(LOCK)).is_ok_and(|lock| lock.try_lock().is_ok()) {
            match std::fs::remove_dir_all(&path) {
                Ok(()) => tracing::info!(folder = %path.display(), "removed the temporary folder of a killed process"),
                Err(error) => tracing::warn!(folder = %path.display(), %error, "a folder cannot be removed"),
            }
        }
    }
}

fn is_folder_of_same_owner(path: &Path, own: &Path) -> bool {
    let (Ok(theirs), Ok(ours)) = (path.symlink_metadata(), own.symlink_metadata()) else { return false };
    theirs.is_dir() && theirs.uid() == ours.uid()
}

fn same_file(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}
