//! The data folder: locked by one process, private to its owner, and checked to be the same folder as at the start.
//! Where the blobs of a job lie in it, and among the blobs.

use std::fs::{File, Permissions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use object_store::path::Path as BlobPath;
use tempfile::TempDir;
use tesserae_mesh::error::{Error, Result};

use crate::ops::private;
use crate::store::JobId;

/// What clients get when the storage cannot be reached; the log says why.
pub(super) const CANNOT_REACH: &str = "the storage of the service cannot be reached; try again later";

pub(super) fn cannot_make(path: &Path, error: io::Error) -> Error {
    Error::io(format_args!("the data folder cannot be used: {}", path.display()), error)
}

pub(crate) const UPLOADS: &str = "uploads";
pub(crate) const RESULTS: &str = "results";
/// Name of the blob with the name of the store that a place belongs to.
pub(crate) const OWNER: &str = "owner";

/// Name of the mesh, or the points, among a job's uploads.
pub(crate) const MESH: &str = "mesh";
pub(crate) const SEEDS: &str = "seeds";
pub(crate) const WEIGHTS: &str = "weights";
/// Name of the edges between points among a job's uploads.
pub(crate) const GRAPH: &str = "graph";

pub(crate) fn buffer(index: usize) -> String {
    format!("buffer-{index}")
}

/// Blobs that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Folder {
    Upload(JobId),
    Result(JobId, u32),
    Results(JobId),
}

impl Folder {
    /// Its path among the blobs, which is that in the data folder.
    pub fn path(self) -> BlobPath {
        match self {
            Folder::Upload(job) => BlobPath::from_iter([UPLOADS, &job.to_string()]),
            Folder::Result(job, attempt) => Folder::Results(job).path().join(attempt.to_string()),
            Folder::Results(job) => BlobPath::from_iter([RESULTS, &job.to_string()]),
        }
    }
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
    /// Takes the folder at `path`, which is made if need be. [`Conflict`](tesserae_mesh::Kind) when another process
    /// works in it. The mode of a folder that is there already stays, because it may hold more than jobs.
    pub fn keep(path: &Path) -> Result<Self> {
        private::make_folder(path).map_err(|error| cannot_make(path, error))?;
        let name = path.join("lock");
        let mut lock = private::options().open(&name).map_err(|error| cannot_make(&name, error))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder = std::fs::read_to_string(&name).unwrap_or_default();
                let (holder, folder) = (holder.trim(), path.display());
                return Err(Error::conflict(format_args!(
                    "another process ({holder}) works in the data folder; stop it, or give this one another \
                     --data-dir: {folder}"
                )));
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

    /// Makes a temporary folder. A process that is killed leaves it.
    pub fn temporary() -> Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix("tesserae-jobs-").permissions(Permissions::from_mode(0o700));
        let folder = builder.tempdir().map_err(|error| cannot_make(&std::env::temp_dir(), error))?;
        Self::taken(folder.path().to_owned(), None, Some(folder))
    }

    pub fn is_kept(&self) -> bool {
        self.temporary.is_none()
    }

    /// Whether the folder is still the one that was opened: not removed, unmounted, or mounted over.
    pub fn check(&self) -> io::Result<()> {
        let (now, taken) = (self.path.metadata()?, self.taken.metadata()?);
        let is_same = (now.dev(), now.ino()) == (taken.dev(), taken.ino());
        if is_same { Ok(()) } else { Err(io::Error::other("it was replaced by another")) }
    }
}
