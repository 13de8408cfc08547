//! The access log: one line a request, written when its answer begins; and the span of the request.
//!
//! Lines have the target `tesserae::access` and no span, whose fields they hold themselves. Probes have no line.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;
use ipnet::IpNet;
use tracing::Span;
use uuid::Uuid;

use crate::guard::access::Caller;
use crate::guard::path;
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
    let mut response = next.run(request).await;
    if let Ok(id) = HeaderValue::from_str(&origin.request) {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    if !PROBES.contains(&path.as_str()) {
        tracing::info!(
            target: "tesserae::access",
            parent: None,
            %method,
            path,
            status = response.status().as_u16(),
            latency_ms = started.elapsed().as_micros() as f64 / 1000.0,
            bytes = response.headers().get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()),
            client = %origin.client,
            tenant = response.extensions().get::<Caller>().and_then(Caller::tenant_name),
            id = origin.request,
            trace = origin.trace.trace(),
            "answered"
        );
    }
    response
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
