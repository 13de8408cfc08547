//! The access log: one line a request, written once its answer was sent; and the span of the request.
//!
//! Lines have the target `tesserae::access` and no span, whose fields they hold themselves. Probes are logged at DEBUG.

use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::TryStreamExt as _;
use hyper::body::{Frame, SizeHint};
use tracing::{Instrument as _, Span};
use uuid::Uuid;

use super::access::Caller;
use super::trace::{Origin, TraceParent};
use super::traffic::origin::{self, Network};
use super::{upload, urls};

/// The target of access lines, for `--log`.
const TARGET: &str = "tesserae::access";

/// Name of the header that carries the id of a request.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id of a request that is taken from the client, in bytes.
const MAX_ID: usize = 128;

/// Paths that probes and monitoring read every few seconds.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Gives a request its id, its [`Origin`] and its span, and logs it once it was answered.
pub(super) async fn log(State(proxies): State<Arc<[Network]>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = request_id(request.headers());
    let trace = TraceParent::of_request(request.headers());
    let client = origin::client(&request, &proxies);
    let path = urls::cut(request.uri().path()).to_owned();
    let span = tracing::info_span!(
        "request",
        method = %request.method(),
        path,
        id,
        trace = %trace.trace(),
        tenant = tracing::field::Empty
    );
    let header = HeaderValue::from_str(&id).ok();
    request.extensions_mut().insert(trace);
    request.extensions_mut().insert(Origin { client, request: id.clone(), trace });
    let method = request.method().clone();
    let received = Arc::<AtomicU64>::default();
    let request = request.map(|body| counted(body, Arc::clone(&received)));
    let is_probe = PROBES.contains(&path.as_str());
    let mut response = next.run(request).instrument(span.clone()).await;
    if let Some(header) = header {
        response.headers_mut().insert(REQUEST_ID, header);
    }
    let status = response.status().as_u16();
    let caller = response.extensions().get::<Caller>();
    let line = Box::new(Line {
        method,
        path,
        status,
        id,
        trace,
        client,
        tenant: caller.and_then(|caller| Some(caller.tenant.as_ref()?.name.clone())),
        received,
        started,
        latency: started.elapsed(),
        is_probe,
    });
    // a body that is streamed from a file does not know its length
    let length = upload::content_length(response.headers());
    response.map(|body| {
        let length = length.or_else(|| body.size_hint().exact());
        Body::new(Logged { body, span, line, length, bytes: 0, is_cut_short: false })
    })
}

/// The id that the client gave the request, if it is short and plain; a new one otherwise.
fn request_id(headers: &HeaderMap) -> String {
    let mut values = headers.get_all(REQUEST_ID).iter();
    let given = values.next().filter(|_| values.next().is_none()).and_then(|value| value.to_str().ok());
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.:/+=@".contains(&byte);
    given
        .filter(|id| (1..=MAX_ID).contains(&id.len()) && id.bytes().all(is_plain))
        .map_or_else(|| Uuid::new_v4().to_string(), str::to_owned)
}

/// What is logged about a request.
struct Line {
    method: Method,
    path: String,
    status: u16,
    id: String,
    trace: TraceParent,
    client: IpAddr,
    tenant: Option<String>,
    /// Bytes of the body that were read, compressed as they are.
    received: Arc<AtomicU64>,
    started: Instant,
    /// Time until the head of the answer.
    latency: Duration,
    is_probe: bool,
}

impl Line {
    fn write(&self, bytes: u64, is_cut_short: bool) {
        let milliseconds = |time: Duration| time.as_micros() as f64 / 1000.0;
        let received = Some(self.received.load(Ordering::Relaxed)).filter(|bytes| *bytes > 0);
        macro_rules! line {
            ($level:ident) => {
                tracing::$level!(
                    target: TARGET,
                    parent: None,
                    method = %self.method,
                    path = self.path,
                    status = self.status,
                    latency_ms = milliseconds(self.latency),
                    duration_ms = milliseconds(self.started.elapsed()),
                    received,
                    bytes,
                    cut_short = is_cut_short.then_some(true),
                    client = %self.client,
                    tenant = self.tenant,
                    id = self.id,
                    trace = %self.trace.trace(),
                    "answered"
                )
            };
        }
        if self.is_probe {
            line!(debug);
        } else {
            line!(info);
        }
    }
}

/// The body of a request, whose bytes are counted.
fn counted(body: Body, bytes: Arc<AtomicU64>) -> Body {
    let count = move |data: &Bytes| {
        bytes.fetch_add(data.len() as u64, Ordering::Relaxed);
    };
    Body::from_stream(body.into_data_stream().inspect_ok(count))
}

/// The body of an answer, whose end is the end of the request.
struct Logged {
    body: Body,
    span: Span,
    line: Box<Line>,
    /// Bytes of the whole body, if its header states them.
    length: Option<u64>,
    /// Bytes that were sent, compressed as they are.
    bytes: u64,
    /// Whether more was to come when the client went away.
    is_cut_short: bool,
}

impl HttpBody for Logged {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let this = &mut *self;
        let polled = this.span.in_scope(|| Pin::new(&mut this.body).poll_frame(context));
        match &polled {
            Poll::Ready(Some(Ok(frame))) => {
                this.bytes += frame.data_ref().map_or(0, |data| data.len() as u64);
                // hyper does not poll again once the declared length was sent
                this.is_cut_short = match this.length {
                    Some(length) => this.bytes < length,
                    None => !this.body.is_end_stream(),
                };
            }
            Poll::Ready(None) => this.is_cut_short = false,
            Poll::Ready(Some(Err(_))) | Poll::Pending => this.is_cut_short = true,
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Logged {
    fn drop(&mut self) {
        self.line.write(self.bytes, self.is_cut_short);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_requests_are_short_and_plain() {
        let id = |values: &[&[u8]]| {
            let mut headers = HeaderMap::new();
            for value in values {
                headers.append(REQUEST_ID, HeaderValue::from_bytes(value).expect("a value"));
            }
            request_id(&headers)
        };
        let longest = "x".repeat(MAX_ID);
        for good in ["a", "0f3c-77:a/b.c_d+e=@", longest.as_str()] {
            assert_eq!(id(&[good.as_bytes()]), good);
        }
        let longer = "x".repeat(MAX_ID + 1);
        for bad in
            [&[b"".as_slice()][..], &[longer.as_bytes()], &[b"a b"], &[b"a\"b"], &["ü".as_bytes()], &[b"a", b"b"], &[]]
        {
            assert!(Uuid::try_parse(&id(bad)).is_ok(), "{bad:?}");
        }
    }
}
