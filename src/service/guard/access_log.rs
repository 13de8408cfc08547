//! The access log: one line a request, written when its answer begins; and the span of the request.
//!
//! Lines have the target `tesserae::access` and no span, whose fields they hold themselves. Probes have no line. A line
//! names a token by its id, never by its secret.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::Response;
use ipnet::IpNet;
use tracing::Instrument as _;

use crate::guard::access::Caller;
use crate::guard::problem::cut_path;
use crate::guard::traffic::origin;
use crate::ops::trace::{Origin, TraceParent};

/// Paths that probes and monitoring read every few seconds.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Gives a request its [`Origin`] and its span, and logs it once it was answered.
pub(crate) async fn log(State(proxies): State<Arc<[IpNet]>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let trace = TraceParent::of_request(request.headers());
    let origin = Origin { client: origin::client(&request, &proxies), trace };
    request.extensions_mut().insert(origin.clone());
    let (method, path) = (request.method().clone(), cut_path(request.uri().path()).to_owned());
    let span =
        tracing::info_span!("request", %method, path, trace = origin.trace.trace(), tenant = tracing::field::Empty);
    let response = next.run(request).instrument(span).await;
    if !PROBES.contains(&path.as_str()) {
        let caller = response.extensions().get::<Caller>();
        let header = |name| response.headers().get(name).and_then(|value| value.to_str().ok());
        tracing::info!(
            target: "tesserae::access",
            parent: None,
            %method,
            path,
            status = response.status().as_u16(),
            latency_ms = started.elapsed().as_micros() as f64 / 1000.0,
            bytes = header(header::CONTENT_LENGTH),
            location = header(header::LOCATION),
            client = %origin.client,
            tenant = caller.and_then(Caller::tenant_name),
            token = caller.and_then(Caller::token_id),
            trace = origin.trace.trace(),
            "answered"
        );
    }
    response
}
