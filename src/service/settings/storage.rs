//! Settings of what is kept, where, and for how long.

use std::time::Duration;

use crate::service::blobs::place::BlobPlace;
use crate::service::files::DiskLimits;

/// What is kept.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct StorageSettings {
    /// Where uploads and results lie that are too large for the store of jobs: a folder, or s3://BUCKET/PREFIX with
    /// keys, region and endpoint in the usual variables AWS_…; in the data folder when left out
    #[arg(long, env = "TESSERAE_BLOBS", value_name = "PLACE")]
    pub blobs: Option<BlobPlace>,

    /// Time for which a job that has ended is kept with its results, in seconds; 0 until it is deleted
    #[arg(long, env = "TESSERAE_RETENTION", value_name = "SECONDS",
          default_value_t = StorageSettings::default().retention)]
    pub retention: u64,

    /// Bytes in the data folder above which uploads are refused; no limit when left out. What lies elsewhere (--blobs)
    /// does not count
    #[arg(long, env = "TESSERAE_MAX_DISK_BYTES", value_name = "BYTES")]
    pub max_disk_bytes: Option<u64>,

    /// Free bytes of the disk below which uploads are refused, so that what was accepted can end
    #[arg(long, env = "TESSERAE_MIN_FREE_BYTES", value_name = "BYTES",
          default_value_t = StorageSettings::default().min_free_bytes)]
    pub min_free_bytes: u64,

    /// Start although the store of jobs is missing or empty and files of jobs are there: these are moved to DIR/aside,
    /// where they stay for a week
    #[arg(long, env = "TESSERAE_FORGET_LOST_JOBS")]
    pub forget_lost_jobs: bool,
}

impl Default for StorageSettings {
    fn default() -> Self {
        Self {
            blobs: None,
            retention: 7 * 86_400,
            max_disk_bytes: None,
            min_free_bytes: 256 << 20,
            forget_lost_jobs: false,
        }
    }
}

impl StorageSettings {
    /// [`retention`](Self::retention) as a duration; none for ever.
    pub(in crate::service) fn retention(&self) -> Option<Duration> {
        (self.retention > 0).then(|| Duration::from_secs(self.retention))
    }

    /// What the data folder may hold.
    pub(in crate::service) fn disk(&self) -> DiskLimits {
        DiskLimits { max_bytes: self.max_disk_bytes, min_free_bytes: self.min_free_bytes }
    }
}
