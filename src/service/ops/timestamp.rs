//! Points in time as RFC 3339 text, in UTC with milliseconds.

use std::time::{SystemTime, UNIX_EPOCH};

use chrono::{DateTime, SecondsFormat};

/// `2026-01-31T23:59:59.123Z`. Times before 1970, and those after all calendars, read as its first moment.
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
