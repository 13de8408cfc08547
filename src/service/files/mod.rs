//! The files of jobs: uploads and results, as blobs in a folder.
//!
//! ```text
//! DIR/lock                          held by the one process that works here
//! DIR/jobs.sqlite3…                 the store of jobs
//! DIR/uploads/{job}/…               from the request until the job ends
//! DIR/results/{job}/{attempt}/…     from the attempt that succeeded until the job is deleted
//! DIR/scratch/…                     what an answer is made of while it is sent
//! ```
//!
//! An upload or a result of a few hundred kilobytes becomes no file: it is handed back as small blobs, for the store to
//! keep with the job. Files cost the disk more than what is in them: for each a place, a name, and two waits.
//!
//! Nothing that a client says becomes part of a path. A blob is whole or not there, and in a folder of the operator's it is
//! on the disk when its writing returns. Whether it means anything, the store of jobs decides: an upload before its job was
//! accepted, and the result of an attempt before it was finished, are swept away after a crash.

mod blob;
mod disk;
mod sweep;

use std::collections::HashSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use futures_util::future::try_join_all;
use object_store::local::LocalFileSystem;
use object_store::path::Path as BlobPath;
use tempfile::TempDir;

pub(super) use self::blob::{Blob, BlobWriter, BlockingWriter};
use self::disk::Disk;
pub(super) use self::disk::DiskLimits;
use super::faults::{FaultPoint, Faults};
use super::store::{JobId, SMALL_BLOBS, SmallBlob};
use crate::error::{Error, Kind, Result};

/// Name of the mesh among a job's uploads.
pub(super) const MESH: &str = "mesh";
/// Name of the list of seeds among a job's uploads.
pub(super) const SEEDS: &str = "seeds";
/// Name of the weights among a job's uploads.
pub(super) const WEIGHTS: &str = "weights";
/// Name of the labels as `.npy` among a job's results; other forms are made of it.
pub(super) const LABELS_NPY: &str = "labels.npy";
/// Name of the labels of iterations among a job's results: `.npy`, a row an iteration.
pub(super) const SNAPSHOTS: &str = "snapshots.npy";
/// Name of the list of those iterations among a job's results.
pub(super) const SNAPSHOT_LIST: &str = "snapshots.json";
/// Name of the hierarchy among a job's results.
pub(super) const HIERARCHY: &str = "hierarchy.tsr";
/// Name of the report among a job's results.
pub(super) const REPORT: &str = "report.json";

/// Name of buffer number `index` among a job's uploads.
pub(super) fn buffer(index: usize) -> String {
    format!("buffer-{index}")
}

/// Blobs that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Folder {
    /// What was uploaded for a job.
    Upload(JobId),
    /// What an attempt at a job gave.
    Result(JobId, u32),
}

impl Folder {
    fn path(self) -> PathBuf {
        match self {
            Folder::Upload(job) => Path::new("uploads").join(job.to_string()),
            Folder::Result(job, attempt) => Path::new("results").join(job.to_string()).join(attempt.to_string()),
        }
    }

    fn blob(self, name: &str) -> BlobPath {
        match self {
            Folder::Upload(job) => BlobPath::from_iter(["uploads", &job.to_string(), name]),
            Folder::Result(job, attempt) => {
                BlobPath::from_iter(["results", &job.to_string(), &attempt.to_string(), name])
            }
        }
    }
}

/// The folder and everything in it.
#[derive(Debug)]
pub(super) struct Files {
    root: Root,
    blobs: LocalFileSystem,
    disk: Disk,
    /// Jobs whose uploads are coming in: nobody else knows them yet.
    incoming: Mutex<HashSet<JobId>>,
    failures: AtomicU64,
    faults: Faults,
}

#[derive(Debug)]
enum Root {
    /// The operator's: everything stays.
    Kept { path: PathBuf, lock: File },
    /// Among the system's temporary files, for as long as the process.
    Temporary(TempDir),
}

impl Files {
    /// Takes the folder `data_dir`, which is made if need be, or a temporary one. A folder that another process works in
    /// is refused.
    pub fn open(data_dir: Option<&Path>, limits: DiskLimits, faults: Faults) -> Result<Self> {
        let root = match data_dir {
            Some(path) => Root::keep(path)?,
            None => {
                let folder = tempfile::Builder::new().prefix("tesserae-jobs-").tempdir();
                Root::Temporary(folder.map_err(|error| cannot_make(&std::env::temp_dir(), error))?)
            }
        };
        for folder in ["uploads", "results", "scratch"] {
            let path = root.path().join(folder);
            std::fs::create_dir_all(&path).map_err(|error| cannot_make(&path, error))?;
        }
        let blobs = LocalFileSystem::new_with_prefix(root.path())
            .map_err(|error| cannot_make(root.path(), io::Error::other(error)))?
            .with_fsync(matches!(root, Root::Kept { .. }));
        let disk = Disk::new(root.path().to_owned(), limits);
        Ok(Self { root, blobs, disk, incoming: Mutex::default(), failures: AtomicU64::new(0), faults })
    }

    /// Where the store of jobs is to be; none in a temporary folder, which nothing outlasts.
    pub fn database(&self) -> Option<PathBuf> {
        match &self.root {
            Root::Kept { path, .. } => Some(path.join("jobs.sqlite3")),
            Root::Temporary(_) => None,
        }
    }

    /// A folder for files without a name.
    pub fn scratch(&self) -> PathBuf {
        self.root.path().join("scratch")
    }

    /// Starts an upload, under the name of the job that it will be.
    pub fn incoming(self: &Arc<Self>) -> Incoming {
        let id = JobId::random();
        self.lock_incoming().insert(id);
        Incoming { files: Arc::clone(self), id, held: Vec::new(), has_files: false, kept: false }
    }

    /// Starts a blob of a result.
    pub fn result(self: &Arc<Self>, job: JobId, attempt: u32, name: &str) -> BlobWriter {
        BlobWriter::new(Arc::clone(self), Folder::Result(job, attempt), name, false)
    }

    /// Removes the upload of a job.
    pub async fn remove_upload(&self, id: JobId) {
        self.remove_folder(Folder::Upload(id).path()).await;
    }

    /// Removes what an attempt at a job left.
    pub async fn remove_result(&self, id: JobId, attempt: u32) {
        self.remove_folder(Folder::Result(id, attempt).path()).await;
    }

    /// Removes everything of a job.
    pub async fn remove(&self, id: JobId) {
        self.remove_upload(id).await;
        self.remove_folder(Path::new("results").join(id.to_string())).await;
    }

    /// Refuses an upload of so many bytes, as far as is known, when there is no room for it or no folder any more.
    pub fn check_room(&self, bytes: u64) -> Result<()> {
        self.check_root()?;
        self.disk.check(bytes)
    }

    /// How often a blob could not be written or read for reasons of the disk.
    pub fn failures(&self) -> u64 {
        self.failures.load(Ordering::Relaxed)
    }

    /// Bytes in the folder: uploads, results and the store of jobs.
    pub fn used_bytes(&self) -> u64 {
        self.disk.used()
    }

    /// Bytes that may still be written to the file system of the folder; none where the system does not tell.
    pub fn free_bytes(&self) -> Option<u64> {
        self.disk.free()
    }

    /// So many bytes of the store of jobs are free for it to use again.
    pub fn free_in_store(&self, bytes: u64) {
        self.disk.free_in_store(bytes);
    }

    /// Whether the folder is there and takes a file; says what is wrong. Blocks.
    pub fn probe(&self) -> Result<()> {
        let cannot = |error| {
            storage_error(
                format_args!("no file can be written in the data folder: {}", self.root.path().display()),
                error,
            )
        };
        self.faults.hit(FaultPoint::ProbeFolder).map_err(cannot)?;
        self.check_root()?;
        let write = || {
            let mut file = tempfile::tempfile_in(self.scratch())?;
            io::Write::write_all(&mut file, &[0; 4096])?;
            file.sync_all()
        };
        write().map_err(cannot)
    }

    /// An error when the folder is not the one that was opened any more.
    fn check_root(&self) -> Result<()> {
        self.root.check().map_err(|error| {
            let what = format_args!("the data folder cannot be used: {}", self.root.path().display());
            Error::new(Kind::Unavailable, format_args!("{what}: {error}"))
        })
    }

    /// Counts an error of the disk.
    fn noted(&self, error: Error) -> Error {
        if error.is_of_storage() {
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
        error
    }

    /// Lets go of the folder: removes a temporary one, and lets another process have one that stays.
    pub async fn close(&self) {
        match &self.root {
            Root::Kept { lock, .. } => {
                if let Err(error) = lock.unlock() {
                    tracing::warn!(%error, "the data folder stays locked until the process ends");
                }
            }
            Root::Temporary(folder) => {
                let _ = tokio::fs::remove_dir_all(folder.path()).await;
            }
        }
    }

    fn lock_incoming(&self) -> MutexGuard<'_, HashSet<JobId>> {
        self.incoming.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Removes a folder below the root, if it is there. What cannot be removed now is swept away later.
    async fn remove_folder(&self, folder: PathBuf) {
        let path = self.root.path().join(folder);
        let removed = blocking(move || {
            let bytes = disk::size(&path);
            std::fs::remove_dir_all(&path).map(|()| bytes).map_err(|error| (path, error))
        });
        match removed.await {
            Ok(Ok(bytes)) => self.disk.removed(bytes),
            Ok(Err((_, error))) if error.kind() == io::ErrorKind::NotFound => {}
            Ok(Err((path, error))) => {
                tracing::warn!(folder = %path.display(), %error, "a folder cannot be removed");
            }
            Err(error) => tracing::warn!(%error, "a folder cannot be removed"),
        }
    }
}

impl Root {
    fn keep(path: &Path) -> Result<Self> {
        std::fs::create_dir_all(path).map_err(|error| cannot_make(path, error))?;
        let name = path.join("lock");
        let mut lock = File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&name)
            .map_err(|error| cannot_make(&name, error))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => {
                let holder = std::fs::read_to_string(&name).unwrap_or_default();
                return Err(Error::new(
                    Kind::Conflict,
                    format_args!(
                        "another process ({}) works in the data folder; stop it, or give this one another --data-dir: {}",
                        holder.trim(),
                        path.display()
                    ),
                ));
            }
            Err(std::fs::TryLockError::Error(error)) => return Err(cannot_make(&name, error)),
        }
        let note = |lock: &mut File| {
            lock.set_len(0)?;
            io::Write::write_all(lock, format!("{}\n", std::process::id()).as_bytes())
        };
        note(&mut lock).map_err(|error| cannot_make(&name, error))?;
        let path = path.canonicalize().map_err(|error| cannot_make(path, error))?;
        Ok(Self::Kept { path, lock })
    }

    fn path(&self) -> &Path {
        match self {
            Root::Kept { path, .. } => path,
            Root::Temporary(folder) => folder.path(),
        }
    }

    /// Whether the folder is still the one that was opened: not removed, unmounted, or mounted over.
    fn check(&self) -> io::Result<()> {
        match self {
            Root::Kept { path, lock } => {
                let (there, held) = (path.join("lock").metadata()?, lock.metadata()?);
                if same_file(&there, &held) { Ok(()) } else { Err(io::Error::other("it was replaced by another")) }
            }
            Root::Temporary(folder) => folder.path().metadata().map(drop),
        }
    }
}

#[cfg(unix)]
fn same_file(one: &std::fs::Metadata, other: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

#[cfg(not(unix))]
fn same_file(one: &std::fs::Metadata, other: &std::fs::Metadata) -> bool {
    one.created().ok() == other.created().ok()
}

/// The blobs of an upload that is coming in; gone when dropped, as when the client hangs up, unless they are kept.
pub(super) struct Incoming {
    files: Arc<Files>,
    id: JobId,
    /// Whole blobs, as long as all are small together.
    held: Vec<BlobWriter>,
    /// Whether they were not, and are files.
    has_files: bool,
    kept: bool,
}

impl Incoming {
    /// The name of the job that the upload will be.
    pub fn id(&self) -> JobId {
        self.id
    }

    /// Starts a blob, to be [added](Self::add) when it is whole.
    pub fn blob(&self, name: &str) -> BlobWriter {
        BlobWriter::new(Arc::clone(&self.files), Folder::Upload(self.id), name, true)
    }

    /// Makes a blob part of the upload.
    pub async fn add(&mut self, blob: BlobWriter) -> Result<()> {
        self.held.push(blob);
        if self.has_files || !are_small(&self.held) {
            self.has_files = true;
            for blob in self.held.drain(..) {
                blob.finish().await?;
            }
        }
        Ok(())
    }

    /// Ends the upload: gives its blobs if they are small and `takes` them, or else makes files of them and gives none.
    pub async fn settle(&mut self, takes: impl FnOnce(u64) -> bool) -> Result<Vec<SmallBlob>> {
        settle(std::mem::take(&mut self.held), takes).await
    }

    /// The job was accepted: the blobs are its upload.
    pub fn keep(mut self) {
        self.kept = true;
    }
}

impl std::fmt::Debug for Incoming {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Incoming").field("id", &self.id).finish_non_exhaustive()
    }
}

/// Ends blobs that belong together: gives them if they are small and `takes` them, or else makes files of them, which wait
/// for the disk together, and gives none.
pub(super) async fn settle(blobs: Vec<BlobWriter>, takes: impl FnOnce(u64) -> bool) -> Result<Vec<SmallBlob>> {
    if are_small(&blobs) && takes(blobs.iter().map(BlobWriter::bytes).sum()) {
        return blobs.into_iter().map(BlobWriter::into_small).collect();
    }
    try_join_all(blobs.into_iter().map(BlobWriter::finish)).await?;
    Ok(Vec::new())
}

fn are_small(blobs: &[BlobWriter]) -> bool {
    blobs.iter().map(BlobWriter::bytes).sum::<u64>() <= SMALL_BLOBS
}

impl Drop for Incoming {
    fn drop(&mut self) {
        let (files, id, kept) = (Arc::clone(&self.files), self.id, self.kept);
        let end = move || files.lock_incoming().remove(&id);
        if kept {
            end();
            return;
        }
        let files = Arc::clone(&self.files);
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            runtime.spawn(async move {
                files.remove_upload(id).await;
                end();
            });
        }
    }
}

/// Runs file work where blocking is allowed.
pub(super) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| Error::new(Kind::Internal, format_args!("work on a file did not end: {error}")))
}

/// The error of a disk that does not take what is to be stored.
fn storage_error(what: impl std::fmt::Display, error: io::Error) -> Error {
    Error::new(Kind::of_storage(&error), format_args!("{what}: {error}"))
}

fn cannot_make(path: &Path, error: io::Error) -> Error {
    Error::io(format_args!("the data folder cannot be used: {}", path.display()), error)
}

#[cfg(test)]
mod tests;
