//! The bounds of work on a job: its panics are caught, its time is limited, its threads are counted. It repeats a
//! failed read or write of its files with growing pauses, and fails after ten minutes.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rayon::{ThreadPool, ThreadPoolBuilder};
use tesserae_mesh::error::{Error, Kind, Result};

use crate::files::Files;

/// Time between two attempts to store what could not be stored.
pub(super) const AGAIN: Duration = Duration::from_millis(500);

/// Runs `work`; a panic becomes an error.
pub(super) fn caught<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work))
        .unwrap_or_else(|_| Err(Error::internal("the job ran into a defect of the service; its log says more")))
}

/// A pool of `threads` threads; of as many as there are processors for 0. None where they cannot be started: then the
/// pool in which meshes are read does the work.
pub(super) fn pool(threads: usize, name: &'static str) -> Option<Arc<ThreadPool>> {
    let name = move |index| format!("{name}-{index}");
    let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(name).build();
    pool.inspect_err(|error| tracing::warn!(%error, "threads for jobs cannot be started")).ok().map(Arc::new)
}

/// What `work` comes to, unless that takes longer than `limit`.
pub(super) async fn within<T>(limit: Option<Duration>, work: impl Future<Output = Result<T>>) -> Result<T> {
    let Some(limit) = limit else { return work.await };
    tokio::time::timeout(limit, work).await.unwrap_or_else(|_| {
        let why = format_args!(
            "the job took longer, on the device and for its results, than a job may, {} s (the service's \
             --max-job-seconds); try a smaller mesh, or fewer iterations (max_iterations)",
            limit.as_secs()
        );
        Err(Error::new(Kind::TimeLimit, why))
    })
}

/// Attempts of a job at its files that failed one after the other. The job keeps its slot and its lease meanwhile.
pub(super) struct Patience {
    files: Arc<Files>,
    limit: Duration,
    pause: Duration,
    /// When the first of them failed.
    since: Option<Instant>,
}

impl Patience {
    /// The job fails when they take longer than `limit`.
    pub fn new(files: &Arc<Files>, limit: Duration) -> Self {
        Self { files: Arc::clone(files), limit, pause: Duration::from_millis(100), since: None }
    }

    /// Repeats `work` until it succeeds, or the job fails.
    pub async fn repeat<T, F: Future<Output = Result<T>>>(&mut self, mut work: impl FnMut() -> F) -> Result<T> {
        loop {
            match work().await {
                Err(error) => self.wait(error).await?,
                done => return done,
            }
        }
    }

    /// Waits until the next attempt. The error of the job when the storage is not at fault, or took too long.
    pub async fn wait(&mut self, error: Error) -> Result<()> {
        if !error.is_of_storage() {
            return Err(error);
        }
        let since = *self.since.get_or_insert_with(|| {
            self.files.stuck.fetch_add(1, Ordering::Relaxed);
            Instant::now()
        });
        if since.elapsed() >= self.limit {
            let why = format_args!(
                "the files of the job could not be read or written for {} s; its upload is kept until the job is \
                 deleted: once the storage of the service works, POST to its path followed by /retry; the last \
                 failure: {error}",
                self.limit.as_secs()
            );
            return Err(Error::new(Kind::InsufficientStorage, why));
        }
        tracing::warn!(%error, pause = ?self.pause, "a file of the job cannot be read or written");
        tokio::time::sleep(self.pause).await;
        self.pause = (2 * self.pause).min(Duration::from_secs(5));
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
