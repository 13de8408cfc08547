//! The files of jobs: uploads and results.
//!
//! A folder a job and kind, named by the job's id; nothing that a client says becomes part of a path. Folders appear
//! whole: they are filled under another name and then renamed.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::store::JobId;
use crate::error::{Error, Result};

/// How often the removal of a folder is tried.
const ATTEMPTS: usize = 100;

/// Name of the mesh in a job's upload folder.
pub(super) const MESH: &str = "mesh";
/// Name of the list of seeds in a job's upload folder.
pub(super) const SEEDS: &str = "seeds";
/// Name of the weights in a job's upload folder.
pub(super) const WEIGHTS: &str = "weights";
/// Name of the labels as `.npy` in a job's result folder.
pub(super) const LABELS_NPY: &str = "labels.npy";
/// Name of the labels as JSON in a job's result folder.
pub(super) const LABELS_JSON: &str = "labels.json";
/// Name of the labels of iterations in a job's result folder: `.npy`, a row an iteration.
pub(super) const SNAPSHOTS: &str = "snapshots.npy";
/// Name of the list of those iterations in a job's result folder.
pub(super) const SNAPSHOT_LIST: &str = "snapshots.json";
/// Name of the hierarchy in a job's result folder.
pub(super) const HIERARCHY: &str = "hierarchy.tsr";
/// Name of the report in a job's result folder.
pub(super) const REPORT: &str = "report.json";

/// Name of buffer number `index` in a job's upload folder.
pub(super) fn buffer(index: usize) -> String {
    format!("buffer-{index}")
}

/// The folders of all jobs of this process; removed with it.
#[derive(Debug)]
pub(super) struct Files {
    root: TempDir,
}

impl Files {
    /// A new, empty folder in `data_dir`, or among the system's temporary files.
    pub fn create(data_dir: Option<&Path>) -> Result<Self> {
        let parent = data_dir.map_or_else(std::env::temp_dir, Path::to_owned);
        let cannot = |error| {
            Error::io(format_args!("the folder for uploads and results cannot be made in {}", parent.display()), error)
        };
        std::fs::create_dir_all(&parent).map_err(cannot)?;
        let root = tempfile::Builder::new().prefix("tesserae-jobs-").tempdir_in(&parent).map_err(cannot)?;
        for folder in ["incoming", "uploads", "results"] {
            std::fs::create_dir(root.path().join(folder)).map_err(cannot)?;
        }
        Ok(Self { root })
    }

    /// Where everything lies.
    pub fn root(&self) -> &Path {
        self.root.path()
    }

    /// Folder of a job's upload.
    pub fn upload(&self, id: JobId) -> PathBuf {
        self.root.path().join("uploads").join(id.to_string())
    }

    /// Folder of a job's result.
    pub fn result(&self, id: JobId) -> PathBuf {
        self.root.path().join("results").join(id.to_string())
    }

    /// A new folder for an upload that is coming in.
    pub async fn incoming(&self) -> Result<Incoming> {
        let parent = self.root.path().join("incoming");
        let folder = blocking(move || TempDir::new_in(parent))
            .await?
            .map_err(|error| Error::io("an upload cannot be stored", error))?;
        Ok(Incoming(Some(folder)))
    }

    /// Removes the upload of a job.
    pub async fn remove_upload(&self, id: JobId) {
        remove(self.upload(id)).await;
    }

    /// Removes everything of a job.
    pub async fn remove(&self, id: JobId) {
        remove(self.upload(id)).await;
        remove(self.result(id)).await;
    }
}

/// Removes a folder, if it exists. What cannot be removed is logged: nobody waits for it.
async fn remove(folder: PathBuf) {
    match tokio::fs::remove_dir_all(&folder).await {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            tracing::warn!(folder = %folder.display(), %error, "a folder cannot be removed");
        }
        _ => {}
    }
}

/// The folder of an upload that is coming in; gone when dropped, as when the client hangs up.
#[derive(Debug)]
pub(super) struct Incoming(Option<TempDir>);

impl Incoming {
    /// Path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        match &self.0 {
            Some(folder) => folder.path().join(name),
            None => PathBuf::from(name),
        }
    }

    /// Makes it the upload folder of a job.
    pub async fn keep_as(mut self, target: PathBuf) -> Result<()> {
        let Some(folder) = self.0.take() else {
            return Ok(());
        };
        blocking(move || {
            std::fs::rename(folder.path(), target)?;
            let _ = folder.keep();
            Ok(())
        })
        .await?
        .map_err(|error| Error::io("an upload cannot be stored", error))
    }
}

impl Drop for Incoming {
    fn drop(&mut self) {
        let Some(folder) = self.0.take() else { return };
        match tokio::runtime::Handle::try_current() {
            Ok(runtime) => drop(runtime.spawn_blocking(move || discard(&folder))),
            Err(_) => discard(&folder),
        }
    }
}

/// Removes a folder in which a file may just be appearing: the client hung up while one was being made.
fn discard(folder: &TempDir) {
    for _ in 0..ATTEMPTS {
        match std::fs::remove_dir_all(folder.path()) {
            Err(error) if error.kind() == std::io::ErrorKind::DirectoryNotEmpty => std::thread::yield_now(),
            Err(error) => return tracing::warn!(%error, "an upload cannot be removed"),
            Ok(()) => return,
        }
    }
}

/// Runs file work where blocking is allowed.
pub(super) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| Error::new(crate::Kind::Internal, format_args!("work on a file did not end: {error}")))
}
