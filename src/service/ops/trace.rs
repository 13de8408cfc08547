//! W3C Trace Context: every request has a trace, its caller's or a new one, and its job and webhook continue it.

use std::fmt;
use std::net::IpAddr;

use axum::http::HeaderMap;
use uuid::Uuid;

/// Where a request comes from, for everything that is logged about it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Origin {
    pub client: IpAddr,
    pub request: String,
    pub trace: TraceParent,
}

/// Trace, span and flags of a `traceparent` header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TraceParent(u128, u64, u8);

impl TraceParent {
    /// A span in the caller's trace; in a new one where the header is absent or not valid.
    pub fn of_request(headers: &HeaderMap) -> Self {
        let header = headers.get("traceparent").and_then(|value| Self::parse(value.to_str().ok()?));
        let (trace, span) = (Uuid::new_v4().as_u128(), Uuid::new_v4().as_u64_pair().1);
        header.map_or(Self(trace, span, 1), |Self(trace, _, flags)| Self(trace, span, flags))
    }

    /// Reads the header (W3C Trace Context §3.2.2).
    pub fn parse(text: &str) -> Option<Self> {
        let fields: Vec<&str> = text.splitn(5, '-').collect();
        let [version, trace, span, flags, ref more @ ..] = fields[..] else { return None };
        let is_known = version != "ff" && (version != "00" || more.is_empty());
        let fits = [version, trace, span, flags].map(str::len) == [2, 32, 16, 2];
        let is_plain = text.bytes().take(55).all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f' | b'-'));
        let (trace, span) = (u128::from_str_radix(trace, 16).ok()?, u64::from_str_radix(span, 16).ok()?);
        let flags = u8::from_str_radix(flags, 16).ok()? & 1;
        (is_plain && is_known && fits && trace != 0 && span != 0).then_some(Self(trace, span, flags))
    }

    /// Id of the trace, in hexadecimal.
    pub fn trace(&self) -> String {
        format!("{:032x}", self.0)
    }
}

/// As in the header.
impl fmt::Display for TraceParent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "00-{}-{:016x}-{:02x}", self.trace(), self.1, self.2)
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
    let [mut headers, none] = [HeaderMap::new(), HeaderMap::new()];
    headers.insert("traceparent", text.parse().expect("a value"));
    let [one, other] = [&headers, &headers].map(TraceParent::of_request);
    assert!(one.0 == other.0 && one.1 != other.1 && TraceParent::of_request(&none).0 != one.0);
}
