//! Web pages that reach a service without tokens through a browser on this machine.
//!
//! | page | what it can do | refused by |
//! |---|---|---|
//! | of a name that resolves to this machine (DNS rebinding) | all, as if it were the service's | `Host` |
//! | of another origin | send requests without a preflight; read no answer | `Sec-Fetch-Site`, `Origin` |
//!
//! `Host` must be an address or `localhost`, unless `--insecure-no-auth` accepts any name. The two others are checked
//! where a request changes something, and an origin in `--cors-origins` passes. A browser sets these headers itself, no
//! page can; other clients send neither `Origin` nor `Sec-Fetch-Site`. With tokens nothing is checked: a page has none.

use std::net::{Ipv4Addr, Ipv6Addr};
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tesserae_mesh::error::{Error, Kind, Quoted, Result};

use crate::guard::problem::Failure;
use crate::settings::AccessSettings;

#[derive(Debug)]
pub(crate) struct Sites {
    has_tokens: bool,
    accepts_names: bool,
    listed: Vec<String>,
}

impl Sites {
    pub fn new(settings: &AccessSettings) -> Self {
        Self {
            has_tokens: settings.tokens.is_some(),
            accepts_names: settings.insecure_no_auth,
            listed: settings.cors_origins.clone(),
        }
    }

    fn check(&self, request: &Request) -> Result<()> {
        if self.has_tokens {
            return Ok(());
        }
        if !self.accepts_names {
            check_hosts(request)?;
        }
        match *request.method() {
            Method::GET | Method::HEAD | Method::OPTIONS => Ok(()),
            _ => self.check_origin(request.headers()),
        }
    }

    /// Refuses what a page of another origin sends. Browsers say which it is in `Sec-Fetch-Site`, also through proxies
    /// that change `Host`, but to `https` and to this machine only; `Origin` they always send.
    fn check_origin(&self, headers: &HeaderMap) -> Result<()> {
        let origin = headers.get(header::ORIGIN).map(|origin| String::from_utf8_lossy(origin.as_bytes()));
        let is_listed = origin.as_ref().is_some_and(|origin| self.listed.iter().any(|listed| listed == origin));
        let is_foreign = match (headers.get("sec-fetch-site").map(|site| site.as_bytes()), &origin) {
            (Some(b"same-origin" | b"none"), _) | (None, None) => false,
            (Some(b"same-site") | None, Some(origin)) => !is_of_host(origin, headers),
            (Some(_), _) => true,
        };
        if !is_foreign || is_listed {
            return Ok(());
        }
        Err(Error::new(
            Kind::ForeignOrigin,
            format_args!(
                "web pages of other origins may not change anything here; list the origin in --cors-origins to let its \
                 pages use the service: {}",
                Quoted(origin.as_deref().unwrap_or_default())
            ),
        ))
    }
}

/// Answers requests that no client but the browser of a foreign page sends.
pub(crate) async fn check(State(sites): State<Arc<Sites>>, request: Request, next: Next) -> Response {
    match sites.check(&request) {
        Ok(()) => next.run(request).await,
        Err(error) => Failure::from(error).into_response(),
    }
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

/// Whether an origin is that of the host that the request names. The scheme is not compared: a proxy may add TLS.
fn is_of_host(origin: &str, headers: &HeaderMap) -> bool {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let Some((scheme, of_origin)) = origin.split_once("://") else { return false };
    let usual = if scheme == "https" { ":443" } else { ":80" };
    !host.is_empty() && of_origin.eq_ignore_ascii_case(host.strip_suffix(usual).unwrap_or(host))
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn verdict(sites: &Sites, method: Method, target: &str, headers: &[(&str, &str)]) -> Option<Kind> {
        let mut request = Request::builder().method(method).uri(target);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        sites.check(&request.body(Body::empty()).expect("a request")).err().map(|error| error.kind)
    }

    #[test]
    fn a_host_is_an_address_or_localhost() {
        let sites = Sites { has_tokens: false, accepts_names: false, listed: Vec::new() };
        for good in
            ["127.0.0.1", "10.1.2.3:8080", "[::1]", "[::1]:8080", "[::ffff:127.0.0.1]:1", "localhost", "LocalHost:1"]
        {
            assert_eq!(verdict(&sites, Method::GET, "/", &[("host", good)]), None, "{good}");
            assert_eq!(verdict(&sites, Method::GET, &format!("http://{good}/"), &[("host", good)]), None, "{good}");
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
            assert_eq!(verdict(&sites, Method::GET, "/", &[("host", bad)]), Some(Kind::Misdirected), "{bad}");
        }
        for (target, host) in [("http://evil.example/", "127.0.0.1"), ("http://127.0.0.1/", "evil.example")] {
            assert_eq!(verdict(&sites, Method::GET, target, &[("host", host)]), Some(Kind::Misdirected), "{target}");
        }
        // HTTP/1.0, which no browser speaks
        assert_eq!(verdict(&sites, Method::GET, "/", &[]), None);
        for sites in [
            Sites { accepts_names: true, ..sites },
            Sites { has_tokens: true, accepts_names: false, listed: Vec::new() },
        ] {
            assert_eq!(verdict(&sites, Method::GET, "/", &[("host", "evil.example")]), None, "{sites:?}");
        }
    }

    #[test]
    fn pages_of_other_origins_change_nothing() {
        let listed = vec!["https://a.example".to_owned()];
        let sites = Sites { has_tokens: false, accepts_names: true, listed };
        for (origin, site, is_refused) in [
            (None, None, false),
            (Some("http://127.0.0.1:8080"), None, false),
            (Some("https://127.0.0.1:8080"), None, false),
            (Some("http://127.0.0.1:8081"), None, true),
            (Some("http://127.0.0.1"), None, true),
            (Some("https://evil.example"), None, true),
            (Some("null"), None, true),
            (Some("https://a.example"), None, false),
            (Some("https://a.example"), Some("cross-site"), false),
            (Some("https://evil.example"), Some("cross-site"), true),
            (None, Some("cross-site"), true),
            (Some("http://127.0.0.1:3000"), Some("same-site"), true),
            (None, Some("same-site"), true),
            (Some("http://127.0.0.1:8080"), Some("same-origin"), false),
            // a proxy that changes Host
            (Some("https://mesh.example"), Some("same-origin"), false),
            (Some("https://evil.example"), Some("anything"), true),
        ] {
            let mut headers = vec![("host", "127.0.0.1:8080")];
            headers.extend(origin.map(|origin| ("origin", origin)));
            headers.extend(site.map(|site| ("sec-fetch-site", site)));
            let expected = is_refused.then_some(Kind::ForeignOrigin);
            for method in [Method::POST, Method::DELETE, Method::PUT] {
                assert_eq!(verdict(&sites, method, "/v1/jobs", &headers), expected, "{headers:?}");
            }
            assert_eq!(verdict(&sites, Method::GET, "/v1/jobs", &headers), None, "{headers:?}");
        }
        let usual = [("host", "mesh.example:80"), ("origin", "http://mesh.example")];
        assert_eq!(verdict(&sites, Method::POST, "/", &usual), None, "the usual port is left out in an origin");
        let with_tokens = Sites { has_tokens: true, accepts_names: false, listed: Vec::new() };
        assert_eq!(verdict(&with_tokens, Method::POST, "/", &[("origin", "https://evil.example")]), None);
    }
}
