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

use crate::guard::access_log;
use crate::guard::problem;
use crate::guard::traffic::{self, heads, sites};
use crate::http::state::Shared;
use crate::http::{conditional, openapi, page};
use crate::metrics::Metrics;

/// Bytes from which on an answer is compressed if the client can read that.
const COMPRESSED_FROM: u64 = 1024;

/// All routes, and around them, from the outside in:
///
/// 1. its origin, its trace, and a span for what is logged about it; its line in the access log;
/// 2. what every answer has, and counting it;
/// 3. compression, of all but event streams, and tags that differ with it;
/// 4. problem documents, of all that is refused further in;
/// 5. a net for panics;
/// 6. heads that are not valid HTTP/1.1, and query strings that are too long;
/// 7. web pages that may not use a service without tokens;
/// 8. access and traffic limits;
/// 9. the routes; around those of results, ETag and Range.
pub(crate) fn router(shared: Arc<Shared>) -> Router {
    let proxies = shared.settings.traffic.trusted_proxies.clone().into();
    let (is_open, accepts_names) = (shared.settings.access.tokens.is_none(), shared.settings.access.insecure_no_auth);
    let layers = ServiceBuilder::new()
        .layer(from_fn_with_state(proxies, access_log::log))
        .layer(from_fn_with_state(Arc::clone(&shared.metrics), every_answer))
        .layer(from_fn(conditional::distinguish_codings))
        .layer(
            CompressionLayer::new()
                .quality(CompressionLevel::Fastest)
                .compress_when(SizeAbove::new(COMPRESSED_FROM).and(NotForContentType::const_new("text/event-stream"))),
        )
        .layer(from_fn_with_state(Arc::clone(&shared.metrics), problem::render))
        // the panic hook logs them
        .layer(CatchPanicLayer::custom(|_: Box<dyn Any + Send>| StatusCode::INTERNAL_SERVER_ERROR.into_response()))
        .layer(from_fn(heads::check))
        .option_layer((is_open && !accepts_names).then(|| from_fn(sites::check)))
        .option_layer(is_open.then(|| CsrfLayer::new().with_rejection_response(sites::foreign)))
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

/// Counts answers, and adds the headers that every answer has: browsers must not guess types, show answers as pages, or
/// cache the data of a tenant. A route may set its own content security policy and caching. The connection of a refused
/// request with a body ends after the answer, since the rest of the body may not have been read.
async fn every_answer(State(metrics): State<Arc<Metrics>>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let (method, has_body) = (request.method().clone(), !request.body().is_end_stream());
    let mut response = next.run(request).await;
    let route = response.extensions().get().map_or("none", MatchedPath::as_str);
    let status = response.status().as_u16();
    metrics.answered(&method, route, status, started.elapsed());
    let headers = response.headers_mut();
    if has_body && status >= 400 {
        headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, "default-src 'none'; frame-ancestors 'none'"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}
