//! Notices: ends of jobs whose webhook is not settled.

use std::fmt;
use std::time::SystemTime;

use async_trait::async_trait;
use tokio::sync::watch;

use super::job::{JobId, State};
use crate::error::{Error, Result};

/// The end of a job whose webhook is to be sent. Outlives its job: a promised webhook is delivered even if the job is
/// deleted first.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::service) struct Notice {
    /// The job.
    pub job: JobId,
    /// The URL of the webhook.
    pub webhook: String,
    /// The `traceparent` of the request that the job came with.
    pub trace_parent: Option<String>,
    /// The state that the job ended in.
    pub state: State,
    /// Why it failed.
    pub problem: Option<Error>,
    /// When it ended.
    pub ended_at: SystemTime,
    /// Number of this end: 1, or more for a job that was retried.
    pub end: u32,
}

/// Keeps the ends of jobs until their webhooks are settled.
#[async_trait]
pub(in crate::service) trait Notices: fmt::Debug + Send + Sync {
    /// Changes whenever a job with a webhook ended: the delivery task waits for it. Marked as changed from the start.
    fn endings(&self) -> watch::Receiver<u64>;

    /// Jobs whose webhook is not settled, in the order of their ends, deleted jobs included. As durable as jobs.
    async fn untold(&self) -> Result<Vec<JobId>>;

    /// The notice of one of the [untold](Self::untold) jobs; none for another job.
    async fn notice(&self, id: JobId) -> Result<Option<Notice>>;

    /// Removes the notice of the end of a job at `ended_at`: its webhook was delivered or given up. Nothing happens for
    /// an unknown job, or one that was retried and has ended again since.
    async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()>;
}
