//! Names: where the blobs of a job lie in the data folder, and among the blobs.

use object_store::path::Path;

use crate::store::JobId;

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
    pub fn path(self) -> Path {
        match self {
            Folder::Upload(job) => Path::from_iter([UPLOADS, &job.to_string()]),
            Folder::Result(job, attempt) => Folder::Results(job).path().join(attempt.to_string()),
            Folder::Results(job) => Path::from_iter([RESULTS, &job.to_string()]),
        }
    }
}
