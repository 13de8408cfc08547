//! Routes, and the layers around them.

use std::any::Any;
use std::sync::Arc;
use std::time::Instant;

use axum::Router;
use axum::body::HttpBody as _;
use axum::extract::{DefaultBodyLimit, MatchedPath, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse as _, Response};
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::predicate::{NotForContentType, Predicate as _, SizeAbove};
use tower_http::compression::{CompressionLayer, CompressionLevel};
use tower_http::csrf::CsrfLayer;
use tracing::Instrument as _;

use crate::guard::access::Caller;
use crate::guard::problem;
use crate::guard::traffic::{self, heads, origin};
use crate::http::state::Shared;
use crate::http::{conditional, openapi, page};
use crate::ops::trace::{Origin, TraceParent};

/// All routes, and around them, from the outside in:
///
/// 1. what every request and every answer has, counting and the access log;
/// 2. compression, of all but event streams and answers below 1,024 bytes, and tags that differ with it;
/// 3. problem documents, of all that is refused further in;
/// 4. a net for panics;
/// 5. heads that are not valid HTTP/1.1, query strings that are too long, and web pages that may not use a service
///    without tokens;
/// 6. access and traffic limits;
/// 7. the routes; around those of results, ETag and Range.
pub(crate) fn router(shared: Arc<Shared>) -> Router {
    let (is_open, accepts_names) = (shared.settings.access.tokens.is_none(), shared.settings.access.insecure_no_auth);
    let layers = ServiceBuilder::new()
        .layer(from_fn_with_state(Arc::clone(&shared), every_request))
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
    let page = page::routes().layer(from_fn(conditional::results));
    let routes = openapi::routes().split_for_parts().0.merge(page).layer(from_fn(remember_route)).with_state(shared);
    // Around the router rather than around each route, where the answers that the router makes itself pass through.
    Router::new().fallback_service(routes).layer(layers)
}

/// Passes the route to the layers around the router, which count answers and do not see it.
async fn remember_route(route: Option<MatchedPath>, request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    if let Some(route) = route {
        response.extensions_mut().insert(route);
    }
    response
}

/// Gives a request its [`Origin`] and its span; counts its answer, logs it, and adds the headers that every answer has:
/// browsers must not guess types, show answers as pages, or cache the data of a tenant. A route may set its own. The
/// connection of a refused request with a body ends after the answer, since parts of the body may not have been read.
///
/// The access log, of the target `tesserae::access`, has a line a request without a span, whose fields the line holds
/// itself. Probes and monitoring, which come every few seconds, have none. A line names a token by its id only.
async fn every_request(State(shared): State<Arc<Shared>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let client = origin::client(&request, &shared.settings.traffic.trusted_proxies);
    let origin = Origin { client, trace: TraceParent::of_request(request.headers()) };
    request.extensions_mut().insert(origin.clone());
    let (method, has_body) = (request.method().clone(), !request.body().is_end_stream());
    let (path, trace) = (problem::cut_path(request.uri().path()).to_owned(), origin.trace.trace());
    let span = tracing::info_span!("request", %method, path, trace, tenant = tracing::field::Empty);
    let mut response = next.run(request).instrument(span).await;
    let (status, elapsed) = (response.status().as_u16(), started.elapsed());
    let route = response.extensions().get().map_or("none", MatchedPath::as_str);
    shared.metrics.answered(&method, route, status, elapsed);
    if !["/healthz", "/readyz", "/metrics"].contains(&path.as_str()) {
        let tenant = response.extensions().get::<Caller>().map(|caller| &caller.0);
        let header = |name| response.headers().get(name).and_then(|value| value.to_str().ok());
        tracing::info!(
            target: "tesserae::access",
            parent: None,
            %method,
            path,
            status,
            latency_ms = elapsed.as_micros() as f64 / 1000.0,
            bytes = header(header::CONTENT_LENGTH),
            location = header(header::LOCATION),
            client = %origin.client,
            tenant = tenant.map(|tenant| &tenant.name),
            token = tenant.and_then(|tenant| tenant.token.as_ref()).map(|token| &token.id),
            trace,
            "answered"
        );
    }
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
