//! Forgetting: jobs that ended long ago go, with their results, and what nobody knows of is swept away.

use std::time::{Duration, Instant, SystemTime};

use futures_util::future::try_join_all;
use tokio_util::sync::CancellationToken;

use super::files::Files;
use super::store::{Deletion, JobStore};
use crate::error::{Error, Result};

/// Jobs that are forgotten before the next look at the time.
const AT_ONCE: usize = 100;

/// Longest time between two looks for jobs that are to be forgotten.
const INTERVAL: Duration = Duration::from_secs(30);

/// Time between two sweeps: what they find was left by a removal that failed.
const SWEEP: Duration = Duration::from_secs(3600);

/// Forgets jobs `retention` after their end, until `stop`; with none, only sweeps.
pub(super) async fn run(files: &Files, store: &dyn JobStore, retention: Option<Duration>, stop: CancellationToken) {
    let interval = retention.map_or(INTERVAL, |retention| (retention / 10).clamp(Duration::from_millis(100), INTERVAL));
    let mut swept = Instant::now();
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            () = tokio::time::sleep(interval) => {}
        }
        if let Some(retention) = retention
            && let Err(error) = expire(files, store, retention).await
        {
            tracing::warn!(%error, "jobs cannot be forgotten now");
        }
        if swept.elapsed() >= SWEEP {
            swept = Instant::now();
            match files.sweep(store).await {
                Ok(removed) => tracing::debug!(removed, "swept"),
                Err(error) => tracing::warn!(%error, "the data folder cannot be swept now"),
            }
        }
    }
}

/// Forgets every job that ended more than `retention` ago.
async fn expire(files: &Files, store: &dyn JobStore, retention: Duration) -> Result<()> {
    let Some(before) = SystemTime::now().checked_sub(retention) else {
        return Ok(());
    };
    loop {
        let old = store.ended_before(before, AT_ONCE).await?;
        // at once: they share a transaction, as many jobs may end as begin
        try_join_all(old.iter().map(async |id| {
            // the job first: without it, its files are nobody's and would be swept away
            if store.delete(*id).await? == Deletion::Deleted {
                files.remove(*id).await;
                tracing::info!(job = %id, "forgotten");
            }
            Ok::<_, Error>(())
        }))
        .await?;
        if old.len() < AT_ONCE {
            return Ok(());
        }
    }
}
