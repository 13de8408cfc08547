//! Routes, and the layers around them.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::HttpBody as _;
use axum::extract::{DefaultBodyLimit, MatchedPath, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse as _, Response};
use tokio_util::sync::CancellationToken;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::predicate::{NotForContentType, Predicate as _, SizeAbove};
use tower_http::compression::{CompressionLayer, CompressionLevel};
use tower_http::csrf::CsrfLayer;
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::trace::TraceLayer;
use tracing::Span;
use tracing::field::Empty;

use crate::guard::problem;
use crate::guard::traffic::{self, heads, origin};
use crate::http::state::Shared;
use crate::http::{conditional, openapi, page};
use crate::ops::trace::{Origin, TraceParent};

const REQUEST_ID: &str = "x-request-id";
const ACCESS: &str = "tesserae::access";

/// The routes, and around them, from the outside in:
///
/// 1. what every request and every answer has, and counting;
/// 2. an id for the request (`x-request-id`), its span, and the access log;
/// 3. compression, of all but event streams and answers below 1,024 bytes, and tags that differ with it;
/// 4. problem documents, of all that is refused further in;
/// 5. a net for panics;
/// 6. heads that are not valid HTTP/1.1, query strings that are too long, and web pages that may not use a service
///    without tokens;
/// 7. access and traffic limits;
/// 8. the routes; around those of results, ETag and Range.
pub(crate) fn router(shared: Arc<Shared>, routes: Router<Arc<Shared>>) -> Router {
    let (is_open, accepts_names) = (shared.settings.access.tokens.is_none(), shared.settings.access.insecure_no_auth);
    let log = TraceLayer::new_for_http().make_span_with(span).on_response(log_answer);
    let layers = ServiceBuilder::new()
        .layer(from_fn_with_state(Arc::clone(&shared), every_request))
        .layer(SetRequestIdLayer::x_request_id(MakeRequestUuid))
        .layer(PropagateRequestIdLayer::x_request_id())
        .layer(log.on_request(()).on_eos(()).on_failure(()))
        .layer(from_fn(conditional::distinguish_codings))
        .layer(
            CompressionLayer::new()
                .quality(CompressionLevel::Fastest)
                .compress_when(SizeAbove::new(1024).and(NotForContentType::const_new("text/event-stream"))),
        )
        .layer(from_fn_with_state(Arc::clone(&shared.metrics), problem::render))
        // the panic hook logs them
        .layer(CatchPanicLayer::custom(|_: Box<dyn Any + Send>| StatusCode::INTERNAL_SERVER_ERROR.into_response()))
        .layer(from_fn_with_state(is_open && !accepts_names, heads::check))
        .option_layer(is_open.then(|| CsrfLayer::new().with_rejection_response(heads::foreign)))
        .layer(from_fn_with_state(Arc::clone(&shared.traffic), traffic::admit))
        // uploads have a limit of their own, counted as they come
        .layer(DefaultBodyLimit::disable());
    // Around the router rather than around each route, where the answers that the router makes itself pass through.
    Router::new().fallback_service(routes.with_state(shared)).layer(layers)
}

/// All routes, which takes a millisecond, as their descriptions are made with them.
pub(crate) fn routes() -> Router<Arc<Shared>> {
    let page = page::routes().layer(from_fn(conditional::results));
    openapi::routes().split_for_parts().0.merge(page).layer(from_fn(remember_route))
}

/// Passes the route to the layers around the router, which count answers and do not see it.
async fn remember_route(route: Option<MatchedPath>, request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    if let Some(route) = route {
        response.extensions_mut().insert(route);
    }
    response
}

/// The span of a request; `Access::caller` adds the tenant and the id of its token. Its level is error so that it is
/// there at every level of the access log.
fn span(request: &Request) -> Span {
    let Some(Origin { client, trace, .. }) = request.extensions().get() else { return Span::none() };
    let (method, path, trace) = (request.method(), problem::cut_path(request.uri().path()), trace.trace());
    let id = request.headers().get(REQUEST_ID).and_then(|id| id.to_str().ok());
    tracing::error_span!(target: ACCESS, "request", %method, path, %client, tenant = Empty, token = Empty, id, trace)
}

/// The access log: a line a request, in its span. Answered probes and `/metrics`, read every few seconds, have none.
fn log_answer(response: &Response, latency: Duration, _: &Span) {
    if !["/healthz", "/readyz", "/metrics"].contains(&route(response)) {
        let header = |name| response.headers().get(name).and_then(|value| value.to_str().ok());
        let (status, latency_ms) = (response.status().as_u16(), latency.as_micros() as f64 / 1000.0);
        let bytes = header(header::CONTENT_LENGTH).and_then(|bytes| bytes.parse::<u64>().ok());
        let location = header(header::LOCATION);
        tracing::info!(target: ACCESS, status, latency_ms, bytes, location, "answered");
    }
}

fn route(response: &Response) -> &str {
    response.extensions().get().map_or("none", MatchedPath::as_str)
}

/// Gives a request its [`Origin`], leaves it an id that is short, plain and no token, counts its answer, and adds the
/// headers that every answer has: browsers must not guess types, show answers as pages, or cache data of tenants. A
/// route may set its own. The connection of a refused request with a body, of which parts may be unread, ends then.
async fn every_request(State(shared): State<Arc<Shared>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let client = origin::client(&request, &shared.settings.traffic.trusted_proxies);
    let trace = TraceParent::of_request(request.headers());
    let gone = CancellationToken::new();
    request.extensions_mut().insert(Origin { client, trace, gone: gone.clone() });
    let _gone = gone.drop_guard();
    let id = request.headers().get(REQUEST_ID).and_then(|id| id.to_str().ok()).unwrap_or_default();
    if id.is_empty() || id.contains('\t') || problem::cut_path(id) != id {
        request.headers_mut().remove(REQUEST_ID);
    }
    let (method, has_body) = (request.method().clone(), !request.body().is_end_stream());
    // a change is made and logged to its end, also when the client hangs up
    let mut response = match method.is_safe() {
        true => next.run(request).await,
        false => {
            tokio::spawn(next.run(request)).await.unwrap_or_else(|_| StatusCode::INTERNAL_SERVER_ERROR.into_response())
        }
    };
    let status = response.status().as_u16();
    shared.metrics.answered(&method, route(&response), status, started.elapsed());
    let headers = response.headers_mut();
    if has_body && status >= 400 {
        headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CONTENT_SECURITY_POLICY, "default-src 'none'; frame-ancestors 'none'"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}
