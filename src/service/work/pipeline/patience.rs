//! A job repeats a failed read or write of its files with growing pauses, and fails after ten minutes.
//!
//! The job keeps its slot and its lease meanwhile. The time begins anew when the process is started again.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use tesserae_mesh::error::{Error, Kind, Result};

use crate::files::Files;

/// Time after which a job fails that cannot read or write its files.
pub(crate) const PATIENCE: Duration = Duration::from_secs(600);

/// First pause, which doubles with every attempt.
const FIRST: Duration = Duration::from_millis(100);

/// Longest pause.
const LONGEST: Duration = Duration::from_secs(5);

/// Attempts of a job at its files that failed one after the other.
pub(super) struct Patience {
    files: Arc<Files>,
    limit: Duration,
    pause: Duration,
    /// When the first of them failed.
    since: Option<Instant>,
}

impl Patience {
    /// None yet; the job fails when they take longer than `limit`.
    pub fn new(files: &Arc<Files>, limit: Duration) -> Self {
        Self { files: Arc::clone(files), limit, pause: FIRST, since: None }
    }

    /// Waits after an attempt that failed, until the next one is due. Gives the error of the job when none is: when
    /// the storage is not at fault, or took too long.
    pub async fn wait(&mut self, error: Error) -> Result<()> {
        if !error.is_of_storage() {
            return Err(error);
        }
        let since = *self.since.get_or_insert_with(|| {
            self.files.stuck.fetch_add(1, Ordering::Relaxed);
            Instant::now()
        });
        if since.elapsed() >= self.limit {
            return Err(Error::new(
                Kind::InsufficientStorage,
                format_args!(
                    "the files of the job could not be read or written for {} s; its upload is kept until the job is \
                     deleted: once the storage of the service works, POST to its path followed by /retry; the last \
                     failure: {error}",
                    self.limit.as_secs()
                ),
            ));
        }
        tracing::warn!(%error, pause = ?self.pause, "a file of the job cannot be read or written");
        tokio::time::sleep(self.pause).await;
        self.pause = (2 * self.pause).min(LONGEST);
        Ok(())
    }
}

impl Drop for Patience {
    fn drop(&mut self) {
        if self.since.is_some() {
            self.files.stuck.fetch_sub(1, Ordering::Relaxed);
        }
    }
}
