//! Deletions, and the care of the store itself.

use std::fmt;
use std::time::SystemTime;

use async_trait::async_trait;

use super::job::JobId;
use crate::error::Result;

/// What a store counts since it was opened, for the metrics.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::service) struct Statistics {
    /// Transactions committed.
    pub commits: u64,
    /// Changes in them: over `commits`, how many share one.
    pub commands: u64,
    /// Transactions that failed.
    pub failures: u64,
    /// Time spent in transactions, in seconds.
    pub commit_seconds: f64,
    /// Attempts that failed because the process ended or their lease was over, with
    /// [`Kind::Unavailable`](crate::Kind::Unavailable).
    pub attempts_failed: u64,
    /// Jobs that were given up after such an attempt.
    pub given_up: u64,
}

/// What came of asking to delete a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::service) enum Deletion {
    /// It is gone.
    Deleted,
    /// It has not ended; it was left as it is.
    Live,
    /// There is no such job.
    Unknown,
}

/// Deletes jobs, and checks the store.
#[async_trait]
pub(in crate::service) trait Maintenance: fmt::Debug + Send + Sync {
    /// Whether jobs outlast the process.
    fn is_durable(&self) -> bool;

    /// Whether other processes use the store, too.
    fn is_shared(&self) -> bool {
        false
    }

    /// Whether this process is the one that cleans up for all: deletes jobs that expired, sweeps files of no job.
    async fn may_clean_up(&self) -> Result<bool> {
        Ok(true)
    }

    /// Bytes on disk that the store has taken and will use again before it takes more.
    async fn free_bytes(&self) -> Result<u64>;

    /// Gives some of the [free bytes](Self::free_bytes) back to the file system: a few megabytes, so that changes of
    /// jobs do not wait for long.
    async fn give_back(&self) -> Result<()>;

    /// Deletes an ended job, its events and its key; its notice stays.
    async fn delete(&self, id: JobId) -> Result<Deletion>;

    /// Jobs that ended before a moment, at most `limit`, the longest ended first.
    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>>;

    /// Writes a row without meaning, to see whether the store can write.
    async fn probe(&self) -> Result<()>;

    /// Counters of the store.
    fn statistics(&self) -> Statistics;

    /// Finishes the operations under way and closes the files. Nothing works afterwards.
    async fn close(&self);
}
