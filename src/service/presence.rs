//! Presence: a process that works on jobs says so every few seconds, for the list of workers.
//!
//! Nothing depends on it: jobs are lost by their leases.

use std::time::Duration;

use tokio_util::sync::CancellationToken;

use super::store::{JobStore, Presence};

/// Time between two announcements.
const EVERY: Duration = Duration::from_secs(5);

/// Announces a worker until `stop`.
pub(super) async fn announce(store: &dyn JobStore, presence: Presence, stop: CancellationToken) {
    loop {
        if let Err(error) = store.announce(&presence).await {
            tracing::debug!(%error, "the worker cannot be announced now");
        }
        tokio::select! {
            () = stop.cancelled() => return,
            () = tokio::time::sleep(EVERY) => {}
        }
    }
}
