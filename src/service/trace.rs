//! Traces: where a request comes from (W3C Trace Context), and that the work on its job belongs to it.
//!
//! Every request has a trace, its caller's or a new one. Its id is in every line of the log about the request and the
//! job.

use std::fmt;
use std::net::IpAddr;

use axum::http::HeaderMap;
use uuid::Uuid;

/// The header that carries it.
const HEADER: &str = "traceparent";

/// A place in a trace: that of a span.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TraceParent {
    trace: u128,
    span: u64,
    is_sampled: bool,
}

/// Id of a trace: 32 hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TraceId(u128);

/// Where a request comes from, for everything that is logged about it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Origin {
    /// Address of the client, behind trusted proxies.
    pub client: IpAddr,
    /// Id of the request.
    pub request: String,
    /// Its trace.
    pub trace: TraceParent,
}

impl TraceParent {
    /// The caller's trace; a new one where the header is absent or not valid.
    pub fn of_request(headers: &HeaderMap) -> Self {
        let mut values = headers.get_all(HEADER).iter();
        let only = values.next().filter(|_| values.next().is_none());
        only.and_then(|value| Self::parse(value.to_str().ok()?)).unwrap_or_else(Self::random)
    }

    /// Reads the header (W3C Trace Context §3.2.2).
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        let is_hexadecimal = |text: &str| text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
        let mut fields = text.split('-');
        let version =
            fields.next().filter(|version| version.len() == 2 && is_hexadecimal(version) && *version != "ff")?;
        let trace = fields.next().filter(|trace| trace.len() == 32 && is_hexadecimal(trace))?;
        let span = fields.next().filter(|span| span.len() == 16 && is_hexadecimal(span))?;
        let flags = fields.next().filter(|flags| flags.len() == 2 && is_hexadecimal(flags))?;
        if version == "00" && fields.next().is_some() {
            return None;
        }
        let found = Self {
            trace: u128::from_str_radix(trace, 16).ok()?,
            span: u64::from_str_radix(span, 16).ok()?,
            is_sampled: u8::from_str_radix(flags, 16).ok()? & 1 == 1,
        };
        (found.trace != 0 && found.span != 0).then_some(found)
    }

    /// Id of the trace.
    pub fn trace(&self) -> TraceId {
        TraceId(self.trace)
    }

    /// A new trace.
    fn random() -> Self {
        let (trace, span) = (Uuid::new_v4().as_u128(), Uuid::new_v4().as_u64_pair().1);
        Self { trace, span, is_sampled: true }
    }
}

impl fmt::Display for TraceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

/// As in the header.
impl fmt::Display for TraceParent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "00-{}-{:016x}-{:02x}", self.trace(), self.span, u8::from(self.is_sampled))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_is_read_and_written_as_the_standard_says() {
        let text = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
        let parsed = TraceParent::parse(text).expect("valid");
        assert_eq!(parsed.to_string(), text);
        assert_eq!(parsed.trace().to_string(), "0af7651916cd43dd8448eb211c80319c");
        // a later version may say more
        assert!(TraceParent::parse("cc-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01-what").is_some());
        for wrong in [
            "",
            "00",
            "ff-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
            "00-00000000000000000000000000000000-b7ad6b7169203331-01",
            "00-0af7651916cd43dd8448eb211c80319c-0000000000000000-01",
            "00-0AF7651916CD43DD8448EB211C80319C-b7ad6b7169203331-01",
            "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01-what",
            "00-0af7651916cd43dd8448eb211c80319-b7ad6b7169203331-01",
            "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-zz",
        ] {
            assert_eq!(TraceParent::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn requests_that_do_not_say_where_they_come_from_are_traces_of_their_own() {
        let (one, other) = (TraceParent::of_request(&HeaderMap::new()), TraceParent::of_request(&HeaderMap::new()));
        assert_ne!(one.trace, other.trace);
        assert_eq!(TraceParent::parse(&one.to_string()), Some(one));
    }
}
