//! The access log: one line a request, written once its answer was sent or given up; and the span of the request.
//!
//! Lines have the target `tesserae::access` and no span, whose fields they hold themselves. Probes have no line.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::TryStreamExt as _;
use ipnet::IpNet;
use tracing::Span;
use uuid::Uuid;

use crate::guard::access::Caller;
use crate::guard::path;
use crate::guard::traffic::guarded::Guarded;
use crate::guard::traffic::origin;
use crate::ops::trace::{Origin, TraceParent};

/// Name of the header that carries the id of a request.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id of a request that is taken from the client, in bytes.
const MAX_ID: usize = 128;

/// Paths that probes and monitoring read every few seconds.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Gives a request its id and its [`Origin`], and logs it once it was answered.
pub(crate) async fn log(State(proxies): State<Arc<[IpNet]>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = request_id(request.headers());
    let trace = TraceParent::of_request(request.headers());
    let origin = Origin { client: origin::client(&request, &proxies), request: id, trace };
    request.extensions_mut().insert(origin.clone());
    let (method, path) = (request.method().clone(), path::cut(request.uri().path()).to_owned());
    let received = Arc::<AtomicU64>::default();
    let counter = Arc::clone(&received);
    let count = move |data: &Bytes| _ = counter.fetch_add(data.len() as u64, Ordering::Relaxed);
    let request = request.map(|body| Body::from_stream(body.into_data_stream().inspect_ok(count)));
    let mut response = next.run(request).await;
    if let Ok(id) = HeaderValue::from_str(&origin.request) {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    let status = response.status().as_u16();
    if PROBES.contains(&path.as_str()) {
        return response;
    }
    let tenant = response.extensions().get::<Caller>().and_then(Caller::tenant_name).map(str::to_owned);
    let latency = started.elapsed();
    let line = Line { method, path, status, origin, tenant, received, sent: 0, started, latency };
    response.map(|body| Body::new(Guarded::noting(body, Box::new(line), |line, bytes| line.sent += bytes)))
}

/// The span of a request that has its [`Origin`].
pub(crate) fn span(request: &Request) -> Span {
    let origin = request.extensions().get::<Origin>();
    tracing::info_span!(
        "request",
        method = %request.method(),
        path = path::cut(request.uri().path()),
        id = origin.map(|origin| origin.request.as_str()),
        trace = origin.map(|origin| origin.trace.trace()),
        tenant = tracing::field::Empty
    )
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

/// What is logged about a request, when this is dropped with the body of the answer.
struct Line {
    method: Method,
    path: String,
    status: u16,
    origin: Origin,
    tenant: Option<String>,
    /// Bytes of the body that were read, compressed as they are.
    received: Arc<AtomicU64>,
    /// Bytes of the answer's body, compressed as they are.
    sent: usize,
    started: Instant,
    /// Time until the head of the answer.
    latency: Duration,
}

impl Drop for Line {
    fn drop(&mut self) {
        let milliseconds = |time: Duration| time.as_micros() as f64 / 1000.0;
        tracing::info!(
            target: "tesserae::access",
            parent: None,
            method = %self.method,
            path = self.path,
            status = self.status,
            latency_ms = milliseconds(self.latency),
            duration_ms = milliseconds(self.started.elapsed()),
            received = Some(self.received.load(Ordering::Relaxed)).filter(|bytes| *bytes > 0),
            bytes = self.sent,
            client = %self.origin.client,
            tenant = self.tenant,
            id = self.origin.request,
            trace = self.origin.trace.trace(),
            "answered"
        );
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
