//! Settings of what is kept, where, and for how long.

use std::time::Duration;

use tesserae_mesh::error::Result;

use super::heading;
use crate::blobs::place::BlobPlace;
use crate::store::StoreUrl;

/// What is kept.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct StorageSettings {
    /// Database that keeps the jobs of several services together, postgres://USER:PASSWORD@HOST/DATABASE; in the data
    /// folder when left out. Connections to other machines are encrypted, and the server is verified, unless the URL
    /// says ?sslmode=disable
    #[arg(long, env = "TESSERAE_STORE", value_name = "URL", hide_env_values = true, help_heading = heading::PLACES,
          hide_short_help = true)]
    pub store: Option<StoreUrl>,

    /// Where uploads and results lie that are too large for the store of jobs: a folder, or s3://BUCKET/PREFIX with
    /// keys, region and endpoint in the usual variables AWS_…; in the data folder when left out
    #[arg(long, env = "TESSERAE_BLOBS", value_name = "PLACE", help_heading = heading::PLACES, hide_short_help = true)]
    pub blobs: Option<BlobPlace>,

    /// Where jobs may name meshes that lie in a bucket (mesh_url): s3://BUCKET/PREFIX, with the keys of --blobs.
    /// {tenant} in it stands for the name of the tenant. Nowhere when left out
    #[arg(long, env = "TESSERAE_MESH_PREFIXES", value_name = "URL,…", value_delimiter = ',',
          help_heading = heading::PLACES, hide_short_help = true)]
    pub mesh_prefixes: Vec<BlobPlace>,

    /// Time for which a job that has ended is kept with its results, in seconds; 0 until it is deleted
    #[arg(long, env = "TESSERAE_RETENTION", value_name = "SECONDS", help_heading = heading::ROOM,
          default_value_t = StorageSettings::default().retention)]
    pub retention: u64,

    /// Free bytes of the disk of the data folder that no upload takes, so that accepted jobs can end: at least 8 MiB.
    /// The default is enough for 1024 small jobs
    #[arg(long, env = "TESSERAE_MIN_FREE_BYTES", value_name = "BYTES",
          hide_short_help = true, help_heading = heading::ROOM,
          default_value_t = StorageSettings::default().min_free_bytes)]
    pub min_free_bytes: u64,
}

impl Default for StorageSettings {
    fn default() -> Self {
        Self { store: None, blobs: None, mesh_prefixes: Vec::new(), retention: 7 * 86_400, min_free_bytes: 256 << 20 }
    }
}

impl StorageSettings {
    /// [`retention`](Self::retention) as a duration; none for ever.
    pub(crate) fn retention(&self) -> Option<Duration> {
        (self.retention > 0).then(|| Duration::from_secs(self.retention))
    }

    /// Checks the URL of the database.
    #[cfg(feature = "postgres")]
    pub(crate) fn check_store(&self) -> Result<()> {
        self.store.as_ref().map_or(Ok(()), |url| crate::store::address::parse(url).map(drop))
    }

    /// Refuses a database: this build knows none.
    #[cfg(not(feature = "postgres"))]
    pub(crate) fn check_store(&self) -> Result<()> {
        match &self.store {
            None => Ok(()),
            Some(_) => Err(tesserae_mesh::error::Error::parameter(
                "this build has no --store: build tesserae with the cargo feature postgres",
            )),
        }
    }
}
