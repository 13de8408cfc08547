//! Health, traces, named faults, and small parts that many rooms use.

pub mod faults;
pub mod health;
pub mod private;
pub mod trace;

use std::time::{SystemTime, UNIX_EPOCH};

use chrono::{DateTime, SecondsFormat};
use tesserae_mesh::error::{Error, Result};

/// Runs work where blocking is allowed.
pub(crate) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|error| Error::internal(format_args!("work on a file did not end: {error}")))
}

/// A number of bytes in a file of `/proc`; none where the system has no such file or line.
pub(crate) fn proc_bytes(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// RFC 3339 in UTC with milliseconds. Times before 1970, and those after all calendars, read as its first moment.
pub(crate) fn rfc3339(time: SystemTime) -> String {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    let time = i64::try_from(since.as_millis()).ok().and_then(DateTime::from_timestamp_millis);
    time.unwrap_or_default().to_rfc3339_opts(SecondsFormat::Millis, true)
}

#[cfg(test)]
#[test]
fn a_moment_reads_as_it_should_and_a_far_one_does_not_panic() {
    let text = |milliseconds| rfc3339(UNIX_EPOCH + std::time::Duration::from_millis(milliseconds));
    assert_eq!(text(1_709_251_199_050), "2024-02-29T23:59:59.050Z");
    assert_eq!(text(u64::MAX / 2), "1970-01-01T00:00:00.000Z");
}
