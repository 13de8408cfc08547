//! Web pages that reach a service without tokens through a browser on this machine.
//!
//! | page | what it can do | refused by |
//! |---|---|---|
//! | of a name that resolves to this machine (DNS rebinding) | all, as if it were the service's | `Host` |
//! | of another origin | send requests without a preflight; read no answer | the headers that [`CsrfLayer`] reads |
//!
//! `Host` must be an address or `localhost`, unless `--insecure-no-auth` accepts any name. With tokens nothing is
//! checked: a page has none.
//!
//! [`CsrfLayer`]: tower_http::csrf::CsrfLayer

use std::net::{Ipv4Addr, Ipv6Addr};

use axum::extract::Request;
use axum::http::header;
use axum::http::uri::Authority;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tesserae_mesh::error::{Error, Kind, Quoted, Result};
use tower_http::csrf::ProtectionError;

use crate::guard::problem::{Answer, Failure};

/// Answers requests with a name in `Host`.
pub(crate) async fn check(request: Request, next: Next) -> Answer {
    check_hosts(&request)?;
    Ok(next.run(request).await)
}

/// The answer to a request that changes something, of a page of another origin.
pub(crate) fn foreign(_: ProtectionError) -> Response {
    let message = "web pages of other origins may not change anything in a service without tokens: use its own page, \
                   or give it --tokens";
    Failure::from(Error::new(Kind::ForeignOrigin, message)).into_response()
}

/// Refuses names: in `Host`, and in a target that is a whole URI, which stands in place of `Host` then.
fn check_hosts(request: &Request) -> Result<()> {
    let in_target = request.uri().authority().map(Authority::as_str);
    let in_header = request.headers().get(header::HOST).map(|host| host.to_str().unwrap_or_default());
    match in_target.into_iter().chain(in_header).find(|host| !is_address_or_localhost(host)) {
        None => Ok(()),
        Some(host) => Err(Error::new(
            Kind::Misdirected,
            format_args!(
                "a service without tokens answers for addresses and localhost only, so that no web page reaches it by \
                 a name; use its address, give it --tokens, or --insecure-no-auth to accept any name: {}",
                Quoted(host)
            ),
        )),
    }
}

/// Whether it is an address or `localhost`, perhaps with a port.
fn is_address_or_localhost(host: &str) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let host = authority.host();
    let in_brackets = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
    match in_brackets {
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
            check_hosts(&request.body(Body::empty()).expect("a request")).is_ok()
        };
        for good in
            ["127.0.0.1", "10.1.2.3:8080", "[::1]", "[::1]:8080", "[::ffff:127.0.0.1]:1", "localhost", "LocalHost:1"]
        {
            assert!(is_taken("/", Some(good)), "{good}");
            assert!(is_taken(&format!("http://{good}/"), Some(good)), "{good}");
        }
        for bad in [
            "evil.example",
            "evil.example:8080",
            "localhost.evil.example",
            "localhost.",
            "x.localhost",
            "127.0.0.1.evil.example",
            "127.1",
            "0x7f.0.0.1",
            "2130706433",
            "[evil]",
            "[127.0.0.1]",
            "::1",
            "",
        ] {
            assert!(!is_taken("/", Some(bad)), "{bad}");
        }
        for (target, host) in [("http://evil.example/", "127.0.0.1"), ("http://127.0.0.1/", "evil.example")] {
            assert!(!is_taken(target, Some(host)), "{target}");
        }
        // HTTP/1.0, which no browser speaks
        assert!(is_taken("/", None));
    }
}
