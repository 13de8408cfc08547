//! Heads of requests that are refused before anything else: those that HTTP/1.1 forbids or that this service does not
//! support (RFC 9112 §3.2 and §6.1), which hyper lets through; query strings that are too long to be parsed; and those
//! of web pages that reach a service without tokens through a browser on this machine.
//!
//! | page | what it can do | refused by |
//! |---|---|---|
//! | of a name that resolves to this machine (DNS rebinding) | all, as if it were the service's | `Host` |
//! | of another origin | send requests without a preflight; read no answer | the headers that [`CsrfLayer`] reads |
//!
//! `Host` must then be an address or `localhost`, unless `--insecure-no-auth` is given. With tokens any name will do.
//!
//! [`CsrfLayer`]: tower_http::csrf::CsrfLayer

use std::net::{Ipv4Addr, Ipv6Addr};

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tesserae_mesh::error::{Error, Kind, Quoted, Result};
use tower_http::csrf::ProtectionError;

use crate::guard::problem::Failure;

/// Longest query string, in bytes.
const MAX_BYTES: usize = 8 << 10;

/// Most parameters of a query string.
const MAX_PARAMETERS: usize = 64;

/// Answers requests that are refused. The connection of an invalid one closes: the next may begin anywhere.
pub(crate) async fn check(State(refuses_names): State<bool>, request: Request, next: Next) -> Response {
    if let Err(error) = check_host(&request).and_then(|()| check_codings(&request)).and_then(|()| check_query(&request))
    {
        return ([(header::CONNECTION, "close")], Failure::from(error)).into_response();
    }
    if refuses_names && let Err(error) = check_name(&request) {
        return Failure::from(error).into_response();
    }
    next.run(request).await
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
        let message = format_args!(
            "the query string has more bytes than the limit of {MAX_BYTES}; send parameters of a job in the part \
             \"parameters\" of a form instead; bytes: {}",
            query.len()
        );
        return Err(Error::new(Kind::UriTooLong, message));
    }
    match form_urlencoded::parse(query.as_bytes()).count() {
        ..=MAX_PARAMETERS => Ok(()),
        parameters => Err(Error::parameter(format_args!(
            "the query string has more parameters than the limit of {MAX_PARAMETERS}: {parameters}"
        ))),
    }
}

/// The answer to a request that changes something, of a page of another origin.
pub(crate) fn foreign(_: ProtectionError) -> Response {
    let message = "web pages of other origins may not change anything in a service without tokens: use its own page, \
                   or give it --tokens";
    Failure::from(Error::new(Kind::ForeignOrigin, message)).into_response()
}

/// Refuses names: in `Host`, and in a target that is a whole URI, which stands in place of `Host` then.
fn check_name(request: &Request) -> Result<()> {
    let in_target = request.uri().authority().map(Authority::as_str);
    let in_header = request.headers().get(header::HOST).map(|host| host.to_str().unwrap_or_default());
    let mut hosts = in_target.into_iter().chain(in_header);
    let Some(name) = hosts.find(|host| !is_address_or_localhost(host)) else { return Ok(()) };
    let message = format_args!(
        "a service without tokens answers for addresses and localhost only, so that no web page reaches it by a name; \
         use its address, give it --tokens, or --insecure-no-auth to accept any name: {}",
        Quoted(name)
    );
    Err(Error::new(Kind::Misdirected, message))
}

/// Whether it is an address or `localhost`, perhaps with a port.
fn is_address_or_localhost(host: &str) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let host = authority.host();
    match host.strip_prefix('[').and_then(|host| host.strip_suffix(']')) {
        Some(host) => host.parse::<Ipv6Addr>().is_ok(),
        None => host.eq_ignore_ascii_case("localhost") || host.parse::<Ipv4Addr>().is_ok(),
    }
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    #[test]
    fn a_host_is_an_address_or_localhost() {
        let is_taken = |target: &str, host: Option<&str>| {
            let request = Request::builder().uri(target);
            let request = host.into_iter().fold(request, |request, host| request.header("host", host));
            check_name(&request.body(Body::empty()).expect("a request")).is_ok()
        };
        let good = "127.0.0.1 10.1.2.3:8080 [::1] [::1]:8080 [::ffff:127.0.0.1]:1 localhost LocalHost:1";
        for good in good.split(' ') {
            assert!(is_taken("/", Some(good)), "{good}");
            assert!(is_taken(&format!("http://{good}/"), Some(good)), "{good}");
        }
        let bad = "evil.example evil.example:8080 localhost.evil.example localhost. x.localhost 127.0.0.1.evil.example \
                   127.1 0x7f.0.0.1 2130706433 [evil] [127.0.0.1] ::1";
        for bad in bad.split(' ').chain([""]) {
            assert!(!is_taken("/", Some(bad)), "{bad}");
        }
        for (target, host) in [("http://evil.example/", "127.0.0.1"), ("http://127.0.0.1/", "evil.example")] {
            assert!(!is_taken(target, Some(host)), "{target}");
        }
        // HTTP/1.0, which no browser speaks
        assert!(is_taken("/", None));
    }
}
