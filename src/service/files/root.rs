//! The data folder: locked by one process, private to its owner, and checked to be the same folder as at the start.

use std::fs::{File, Permissions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use tesserae_mesh::error::{Error, Kind, Result};

use crate::ops::private;

/// What clients get when the storage cannot be reached; the log says why.
pub(super) const CANNOT_REACH: &str = "the storage of the service cannot be reached; try again later";

pub(super) fn storage_error(what: impl std::fmt::Display, error: io::Error) -> Error {
    Error::new(Kind::of_storage(&error), format_args!("{what}: {error}"))
}

pub(super) fn cannot_make(path: &Path, error: io::Error) -> Error {
    Error::io(format_args!("the data folder cannot be used: {}", path.display()), error)
}

#[derive(Debug)]
pub(super) struct Root {
    pub path: PathBuf,
    /// None for `--data-dir`, where everything stays.
    pub temporary: Option<TempDir>,
    /// None of a temporary folder, which no other process knows.
    pub lock: Option<File>,
    /// The folder when it was taken. It is held open, so that no other one gets its number.
    taken: File,
}

impl Root {
    /// Takes the folder at `path`, which is made if need be. [`Kind::Conflict`] when another process works in it. The
    /// mode of a folder that is there already stays, because it may hold more than jobs.
    pub fn keep(path: &Path) -> Result<Self> {
        private::make_folder(path).map_err(|error| cannot_make(path, error))?;
        let name = path.join("lock");
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
        // the number is for messages only
        if let Err(error) = lock.set_len(0).and_then(|()| writeln!(lock, "{}", std::process::id()))
            && error.kind() != io::ErrorKind::StorageFull
        {
            return Err(cannot_make(&name, error));
        }
        let path = path.canonicalize().map_err(|error| cannot_make(path, error))?;
        let root = Self::taken(path, Some(lock), None)?;
        let mode = root.taken.metadata().map_or(0, |found| found.permissions().mode() & 0o777);
        if mode & 0o077 != 0 {
            let (folder, mode) = (root.path.display(), format!("{mode:04o}"));
            tracing::warn!(%folder, mode, "other users may enter the data folder; `chmod 700` takes that away");
        }
        Ok(root)
    }

    fn taken(path: PathBuf, lock: Option<File>, temporary: Option<TempDir>) -> Result<Self> {
        let taken = File::open(&path).map_err(|error| cannot_make(&path, error))?;
        Ok(Self { path, temporary, lock, taken })
    }

    /// Makes a temporary folder in `among`. A process that is killed leaves it.
    pub fn temporary(among: &Path) -> Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix("tesserae-jobs-").permissions(Permissions::from_mode(0o700));
        let folder = builder.tempdir_in(among).map_err(|error| cannot_make(among, error))?;
        Self::taken(folder.path().to_owned(), None, Some(folder))
    }

    pub fn is_kept(&self) -> bool {
        self.temporary.is_none()
    }

    /// Whether the folder is still the one that was opened: not removed, unmounted, or mounted over.
    pub fn check(&self) -> io::Result<()> {
        let (now, taken) = (self.path.metadata()?, self.taken.metadata()?);
        match (now.dev(), now.ino()) == (taken.dev(), taken.ino()) {
            true => Ok(()),
            false => Err(io::Error::other("it was replaced by another")),
        }
    }
}
