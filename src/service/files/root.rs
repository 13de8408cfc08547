//! The data folder: locked by one process, private to its owner, and checked to be the same folder as at the start.

use std::fs::{File, Metadata, Permissions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use tesserae_mesh::error::{Error, Kind, Result};

use super::failure::cannot_make;
use crate::ops::private;

pub(super) const LOCK: &str = "lock";

pub(super) const STORE: &str = "jobs.sqlite3";

#[derive(Debug)]
pub(super) struct Root {
    pub path: PathBuf,
    /// The folder among the system's temporary files that goes with the process; none for `--data-dir`, where
    /// everything stays.
    pub temporary: Option<TempDir>,
    /// None of a temporary folder, which no other process knows.
    pub lock: Option<File>,
    /// The folder when it was taken. It is held open, so that no other one gets its number.
    found: Metadata,
    _open: Option<File>,
}

impl Root {
    /// Takes the folder at `path`, which is made if need be. [`Kind::Conflict`] when another process works in it.
    ///
    /// The mode of a folder that is there already stays, because it may hold more than jobs; what the service makes in
    /// it is for the owner only.
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
        let noted = lock.set_len(0).and_then(|()| writeln!(lock, "{}", std::process::id()));
        match noted {
            // the number is for messages only
            Err(error) if error.kind() != io::ErrorKind::StorageFull => return Err(cannot_make(&name, error)),
            Ok(()) | Err(_) => {}
        }
        let path = path.canonicalize().map_err(|error| cannot_make(path, error))?;
        if let Some(mode) = private::open_mode(&path) {
            let (folder, mode) = (path.display(), format!("{mode:04o}"));
            tracing::warn!(%folder, mode, "other users may enter the data folder; `chmod 700` takes that away");
        }
        Self::taken(path, Some(lock), None)
    }

    fn taken(path: PathBuf, lock: Option<File>, temporary: Option<TempDir>) -> Result<Self> {
        let found = path.metadata().map_err(|error| cannot_make(&path, error))?;
        Ok(Self { _open: File::open(&path).ok(), path, temporary, lock, found })
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
        let now = self.path.metadata()?;
        match (now.dev(), now.ino()) == (self.found.dev(), self.found.ino()) {
            true => Ok(()),
            false => Err(io::Error::other("it was replaced by another")),
        }
    }
}
