//! W3C Trace Context: every request has a trace, its caller's or a new one, and its job and webhook continue it.

use std::fmt;
use std::net::IpAddr;

use axum::http::HeaderMap;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

/// Where a request comes from, for everything that is logged about it.
#[derive(Debug, Clone)]
pub(crate) struct Origin {
    pub client: IpAddr,
    pub trace: TraceParent,
    /// Cancelled when the client has its answer or has hung up.
    pub gone: CancellationToken,
}

/// A `traceparent` header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TraceParent(String);

impl TraceParent {
    /// The caller's; a new one where the header is absent or not valid.
    pub fn of_request(headers: &HeaderMap) -> Self {
        headers.get("traceparent").and_then(|value| Self::parse(value.to_str().ok()?)).unwrap_or_else(|| {
            let (trace, span) = (Uuid::new_v4().simple(), Uuid::new_v4().as_u64_pair().1);
            Self(format!("00-{trace}-{span:016x}-01"))
        })
    }

    /// Reads the header (W3C Trace Context §3.2.2), of a later version as far as this one knows it.
    pub fn parse(text: &str) -> Option<Self> {
        let fields: Vec<&str> = text.splitn(5, '-').collect();
        let [version, trace, span, flags, ref more @ ..] = fields[..] else { return None };
        let is_known = version != "ff" && (version != "00" || more.is_empty());
        let fits = [version, trace, span, flags].map(str::len) == [2, 32, 16, 2];
        let is_plain = text.bytes().take(55).all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f' | b'-'));
        let is_zero = |id: &str| id.bytes().all(|byte| byte == b'0');
        let is_valid = is_plain && is_known && fits && !is_zero(trace) && !is_zero(span);
        is_valid.then(|| Self(format!("00-{trace}-{span}-{flags}")))
    }

    /// Id of the trace, in hexadecimal.
    pub fn trace(&self) -> &str {
        &self.0[3..35]
    }
}

impl fmt::Display for TraceParent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
#[test]
fn the_header_is_read_and_written_as_the_standard_says() {
    let text = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
    assert_eq!(TraceParent::parse(text).map(|parent| parent.to_string()).as_deref(), Some(text));
    assert!(TraceParent::parse(&format!("{text}-more").replacen("00", "cc", 1)).is_some(), "a later version");
    for (part, wrong) in [("00", "ff"), ("af", "AF"), ("01", "zz"), ("01", "01-more"), ("0af", "af"), ("-01", "")] {
        assert_eq!(TraceParent::parse(&text.replacen(part, wrong, 1)), None, "{part} {wrong}");
    }
    let mut headers = HeaderMap::new();
    let made = TraceParent::of_request(&headers);
    assert_eq!(TraceParent::parse(&made.to_string()), Some(made));
    headers.insert("traceparent", text.parse().expect("a value"));
    assert_eq!(TraceParent::of_request(&headers).to_string(), text);
}
