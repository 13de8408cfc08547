//! The bounds of work on a job: its panics are caught, its time is limited, its threads are counted, its
//! end is stored again and again.

use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::Outcome;

/// Time between two attempts to store what could not be stored.
pub(super) const AGAIN: Duration = Duration::from_millis(500);

/// Runs `work`; a panic becomes an error.
pub(super) fn caught<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(Error::new(Kind::Internal, "the job ran into a defect of the service; its log says more"))
    })
}

/// A pool of `threads` threads; of as many as there are processors for 0.
pub(super) fn pool(threads: usize, name: impl FnMut(usize) -> String + 'static) -> Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(name).build();
    pool.map_err(|error| Error::new(Kind::Io, format_args!("threads of the device cannot be started: {error}")))
}

/// What `work` comes to, unless that takes longer than `limit`.
pub(super) async fn within(limit: Option<Duration>, work: impl Future<Output = Result<Outcome>>) -> Result<Outcome> {
    let Some(limit) = limit else { return work.await };
    tokio::time::timeout(limit, work).await.unwrap_or_else(|_| {
        Err(Error::new(
            Kind::TimeLimit,
            format_args!(
                "the job took longer, on the device and for its results, than a job may, {} s (the service's \
                 --max-job-seconds); try a smaller mesh, or fewer iterations (max_iterations)",
                limit.as_secs()
            ),
        ))
    })
}
