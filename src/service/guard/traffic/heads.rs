//! Heads of requests that HTTP/1.1 forbids or that this service does not support (RFC 9112 §3.2 and §6.1), which hyper
//! lets through, and query strings that are too long to be parsed.

use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderValue, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tesserae_mesh::error::{Error, Kind, Result};

use crate::guard::problem::Failure;
use crate::guard::query;

/// Longest query string, in bytes.
const MAX_BYTES: usize = 8 << 10;

/// Most parameters of a query string.
const MAX_PARAMETERS: usize = 64;

/// Answers requests with such a head, and closes their connections: where the next request begins is then uncertain.
pub(crate) async fn check(request: Request, next: Next) -> Response {
    let checked = check_host(&request).and_then(|()| check_codings(&request)).and_then(|()| check_query(&request));
    let Err(error) = checked else {
        return next.run(request).await;
    };
    let mut response = Failure::from(error).into_response();
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}

/// HTTP/1.1 needs exactly one `Host`, so that proxies and services agree on the target; HTTP/1.0 at most one.
fn check_host(request: &Request) -> Result<()> {
    let wrong = |message| Err(Error::new(Kind::BadRequest, message));
    let mut hosts = request.headers().get_all(header::HOST).iter();
    match (hosts.next(), hosts.next()) {
        (None, _) if request.version() < Version::HTTP_11 => Ok(()),
        (None, _) => wrong("a request of HTTP/1.1 must have a Host header; it has none"),
        (Some(_), Some(_)) => wrong("a request must have one Host header; it has several"),
        (Some(host), None) if host.is_empty() => Ok(()),
        // without the user that an authority may begin with
        (Some(host), None) if Authority::try_from(host.as_bytes()).is_ok_and(|it| !it.as_str().contains('@')) => Ok(()),
        (Some(_), None) => wrong("the Host header must be a host and perhaps a port; it is something else"),
    }
}

/// hyper decodes the transfer coding `chunked` and passes any other one on as if it were part of the content.
fn check_codings(request: &Request) -> Result<()> {
    let mut codings = request.headers().get_all(header::TRANSFER_ENCODING).iter();
    match (codings.next(), codings.next()) {
        (None, _) => Ok(()),
        (Some(coding), None) if coding.as_bytes().trim_ascii().eq_ignore_ascii_case(b"chunked") => Ok(()),
        _ => Err(Error::new(
            Kind::NotImplemented,
            "the only Transfer-Encoding that is supported is chunked; compressed uploads say so in Content-Encoding",
        )),
    }
}

fn check_query(request: &Request) -> Result<()> {
    let query = request.uri().query().unwrap_or_default();
    if query.len() > MAX_BYTES {
        return Err(Error::new(
            Kind::UriTooLong,
            format_args!(
                "the query string has more bytes than the limit of {MAX_BYTES}; send parameters of a job in the part \
                 \"parameters\" of a form instead; bytes: {}",
                query.len()
            ),
        ));
    }
    match query::pairs(query).count() {
        ..=MAX_PARAMETERS => Ok(()),
        parameters => Err(Error::parameter(format_args!(
            "the query string has more parameters than the limit of {MAX_PARAMETERS}: {parameters}"
        ))),
    }
}
