//! Errors as problem documents (RFC 9457).
//!
//! Handlers return [`Failure`]; it carries the error in the response's extensions. [`render`], a layer around the whole
//! router, writes the document: there the path (`instance`) is known, and what the framework refuses by itself (unknown
//! paths, methods, panics) passes through too.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::sync::{Arc, LazyLock};

use axum::extract::{Request, State};
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use percent_encoding::percent_decode_str;
use serde::Serialize;
use tesserae_mesh::error::{Error, Kind};
use tesserae_mesh::job::InputFormat;
use utoipa::{ToResponse, ToSchema};

use crate::guard::access::tokens::TOKEN_PREFIX;
use crate::metrics::Metrics;

/// The media types of bodies that are read, for `Accept-Post` and for messages.
pub(crate) static ACCEPTED: LazyLock<String> = LazyLock::new(|| {
    let files = InputFormat::all().flat_map(InputFormat::media_types).copied();
    files.chain(["multipart/form-data", "application/octet-stream"]).collect::<Vec<_>>().join(", ")
});

/// The content codings of bodies that are read, for `Accept-Encoding` and for messages.
pub(crate) const ENCODINGS: &str = "gzip, zstd, identity";

/// Longest path or id of a request that is logged or sent back, in bytes.
const MAX_PATH: usize = 256;

/// What went wrong (RFC 9457).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub(crate) struct Problem {
    /// Which kind of problem: `/problems/…`, the same for every problem of the kind.
    #[serde(rename = "type")]
    #[schema(example = "/problems/invalid-parameter")]
    pub kind: String,
    /// The kind in words.
    #[schema(example = "A parameter is not valid")]
    pub title: String,
    /// HTTP status.
    #[schema(minimum = 400, maximum = 599, example = 422)]
    pub status: u16,
    /// What is wrong, where, and what to do.
    #[schema(example = "clusters must be at least 1, not 0")]
    pub detail: String,
    /// Path of the request, or of the job, that it happened to; a long one is cut.
    #[schema(example = "/v1/jobs")]
    pub instance: String,
}

/// What went wrong.
#[derive(ToResponse)]
#[response(description = "What went wrong (RFC 9457)", content_type = "application/problem+json")]
#[expect(dead_code, reason = "describes answers for openapi.yaml")]
pub(crate) struct Problematic(Problem);

impl Problem {
    /// The document of `error`, which happened to the resource at path `instance`.
    pub fn new(error: &Error, instance: impl Into<String>) -> Self {
        Self {
            kind: format!("/problems/{}", error.kind.slug()),
            title: error.kind.title().to_owned(),
            status: error.kind.status(),
            detail: error.message.clone(),
            instance: instance.into(),
        }
    }
}

/// An error on its way to the client. `instance` is the path of the request unless it is set.
#[derive(Debug, Clone)]
pub(crate) struct Failure {
    pub error: Error,
    /// Path of the resource it happened to, when that is not the request's.
    pub instance: Option<String>,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self { error, instance: None }
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let mut response = status(self.error.kind).into_response();
        let headers = response.headers_mut();
        if self.error.kind == Kind::UnsupportedMediaType {
            headers.insert("accept-post", HeaderValue::from_static(&ACCEPTED));
            headers.insert(header::ACCEPT_ENCODING, HeaderValue::from_static(ENCODINGS));
        }
        if self.error.kind == Kind::Unauthorized {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"tesserae\""));
        }
        response.extensions_mut().insert(self);
        response
    }
}

pub(crate) type Answer<T = Response> = Result<T, Failure>;

/// Turns every error response that is no problem document yet into one.
pub(crate) async fn render(State(metrics): State<Arc<Metrics>>, request: Request, next: Next) -> Response {
    let (path, method) = (request.uri().path().to_owned(), request.method().clone());
    let mut response = next.run(request).await;
    if response.status().as_u16() < 400 {
        return response;
    }
    let known = response.extensions_mut().remove::<Failure>();
    let failure = known.unwrap_or_else(|| refused_by_framework(&response, &method, &path).into());
    metrics.families.rejections.get_or_create(&[("reason", failure.error.kind.slug())]).inc();
    match failure.error.kind {
        // what every client gets while the service stops; a disk that takes no job is logged once, as a failing part
        Kind::Unavailable | Kind::Overloaded | Kind::InsufficientStorage => {
            tracing::debug!(kind = failure.error.kind.slug(), "{}", failure.error)
        }
        // logged with its job where it was found; the client's doing
        Kind::Damaged | Kind::NotImplemented => {}
        kind if kind.status() >= 500 => tracing::error!(kind = kind.slug(), "{}", failure.error),
        _ => {}
    }
    let instance = failure.instance.unwrap_or_else(|| cut_path(&path).to_owned());
    *response.status_mut() = status(failure.error.kind);
    *response.body_mut() = axum::Json(Problem::new(&failure.error, instance)).into_response().into_body();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
    headers.remove(header::CONTENT_LENGTH);
    if failure.error.kind.is_retryable() {
        // seconds
        headers.insert(header::RETRY_AFTER, HeaderValue::from_static("5"));
    }
    response
}

/// The error for a response that the router or a layer made by itself.
fn refused_by_framework(response: &Response, method: &Method, path: &str) -> Error {
    let shown = cut_path(path);
    match response.status() {
        // an id that is no text: what cannot be written cannot be there
        StatusCode::BAD_REQUEST if percent_decode_str(path).decode_utf8().is_err() => Error::not_found(format_args!(
            "there is nothing at this path, which is not UTF-8 once its percent signs are decoded: {shown}"
        )),
        StatusCode::NOT_FOUND => {
            Error::not_found(format_args!("there is nothing at this path; /openapi.yaml lists what there is: {shown}"))
        }
        StatusCode::METHOD_NOT_ALLOWED => {
            let allowed = response.headers().get(header::ALLOW);
            let allowed = allowed.and_then(|value| value.to_str().ok()).unwrap_or("no method");
            Error::new(Kind::MethodNotAllowed, format_args!("this resource answers {allowed}, not {method}"))
        }
        status if status.is_server_error() => {
            Error::internal("the service ran into a defect while it answered; its log says more")
        }
        status => Error::new(Kind::BadRequest, format_args!("the request cannot be read: {status}")),
    }
}

fn status(kind: Kind) -> StatusCode {
    StatusCode::from_u16(kind.status()).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
}

/// The beginning of a path, at most up to a token that a client wrote into it, with percent signs or without.
pub(crate) fn cut_path(path: &str) -> &str {
    let path = &path[..path.floor_char_boundary(MAX_PATH)];
    match percent_decode_str(path).decode_utf8_lossy().contains(TOKEN_PREFIX) {
        true => path.split(TOKEN_PREFIX).flat_map(|part| part.split('%')).next().unwrap_or_default(),
        false => path,
    }
}

#[cfg(test)]
#[test]
fn a_path_is_cut_between_characters_and_before_a_token() {
    assert_eq!(cut_path("/v1/jobs%20"), "/v1/jobs%20");
    for token in ["tess_one_secret", "%74ess_one_secret", "t%65ss%5fone", "%20tess_one"] {
        let (end, path) = (token.find('%').unwrap_or_default(), format!("/v1/{token}/jobs"));
        assert_eq!(cut_path(&path), &path[..4 + end]);
    }
    let long = format!("/{}", "ü".repeat(500));
    assert!(cut_path(&long).len() == MAX_PATH - 1 && long.starts_with(cut_path(&long)));
}
