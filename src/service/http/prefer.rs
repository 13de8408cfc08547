//! The `Prefer` header (RFC 7240): `wait=N`, in seconds. Everything else in it is ignored, as the standard requires.

use std::time::Duration;

use axum::http::HeaderMap;

/// Longest wait: proxies give up on an answer after a minute.
const LONGEST: Duration = Duration::from_secs(60);

/// The time that the client wants to wait, at most [`LONGEST`].
pub(crate) fn wait(headers: &HeaderMap) -> Option<Duration> {
    headers
        .get_all("prefer")
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .filter_map(|preference| {
            let (name, rest) = preference.split_once('=')?;
            let value = rest.split(';').next()?.trim().trim_matches('"');
            name.trim().eq_ignore_ascii_case("wait").then(|| value.parse().ok())?
        })
        // the first one counts
        .next()
        .map(|seconds| Duration::from_secs(seconds).min(LONGEST))
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    #[test]
    fn the_first_wait_counts_up_to_the_cap() {
        for (header, expected) in [
            ("wait=5", Some(5)),
            ("respond-async, Wait = \"7\"; x=y, wait=9", Some(7)),
            ("wait=100000", Some(60)),
            ("wait", None),
            ("wait=soon", None),
            ("wait=-1", None),
            ("return=minimal", None),
        ] {
            let mut headers = HeaderMap::new();
            headers.insert("prefer", HeaderValue::from_static(header));
            assert_eq!(wait(&headers), expected.map(Duration::from_secs), "{header}");
        }
        assert_eq!(wait(&HeaderMap::new()), None);
    }
}
