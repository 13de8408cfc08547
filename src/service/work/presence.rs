//! Presence: a process that works on jobs says so every few seconds, for the list of workers.
//!
//! Nothing depends on it: jobs are lost by their leases.

use std::time::Duration;

use tokio_util::sync::CancellationToken;

use crate::store::Store;

/// Longest name of a host that a worker is named after, in bytes.
const MAX_HOST: usize = 128;

/// Time between two announcements.
const EVERY: Duration = Duration::from_secs(5);

/// Name of this process in the jobs that it works on: host name and process id.
pub(crate) fn worker_name() -> String {
    let file = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let host = file.or_else(|| std::env::var("HOSTNAME").ok()).map(|host| host.trim().to_owned());
    let host = host.filter(|host| (1..=MAX_HOST).contains(&host.len()) && host.chars().all(|c| c.is_ascii_graphic()));
    format!("{}-{}", host.as_deref().unwrap_or("tesserae"), std::process::id())
}

pub(crate) async fn announce(store: &Store, name: &str, device: &str, stop: CancellationToken) {
    loop {
        if let Err(error) = store.announce(name, device).await {
            tracing::debug!(%error, "the worker cannot be announced now");
        }
        tokio::select! {
            () = stop.cancelled() => return,
            () = tokio::time::sleep(EVERY) => {}
        }
    }
}
