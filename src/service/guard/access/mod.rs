//! Authentication: from tokens to tenants.
//!
//! Every request passes [`Access::caller`]; handlers take [`Caller`] and find jobs by it, so that a job of another
//! tenant is not there. Without tokens all requests are of one tenant. A token is never logged, nor part of an error.

mod file;
pub(crate) mod tokens;

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::watch;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use self::file::{Stamp, stamp};
use self::tokens::{Tenant, Tokens};
use crate::guard::problem::Failure;
use crate::ops::blocking;
use crate::ops::health::{Health, Part};
use crate::settings::AccessSettings;
use crate::store::LOCAL_TENANT;

/// Paths that need no token: those of probes, proxies, readers of the description, and the page; without data of jobs.
const OPEN: &str = "/healthz /readyz /v1/version /openapi.yaml / /page.js /scene.js /page.css /mark.svg /share.jpg \
                    /licences.txt /knot.glb /knot.tsr";

/// Paths with data of all tenants.
const OF_ALL_TENANTS: [&str; 2] = ["/metrics", "/v1/workers"];

/// The sender of a request. A path that needs no token has none.
#[derive(Debug, Clone)]
pub(crate) struct Caller(pub Arc<Tenant>);

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Failure> {
        parts.extensions.get::<Self>().cloned().ok_or_else(|| Error::internal("the request has no caller").into())
    }
}

#[derive(Debug)]
pub(crate) struct Access {
    /// The file of tokens, and what it was when it was read first; none without tokens.
    file: Option<(PathBuf, Stamp)>,
    pub tokens: watch::Sender<Arc<Tokens>>,
}

impl Access {
    /// Reads the tokens, if there are to be some.
    pub async fn open(settings: &AccessSettings) -> Result<Self> {
        let (file, tokens) = match settings.tokens.clone() {
            Some(path) => {
                // before they are read: what changes meanwhile is read again
                let first = on_file(&path, stamp).await?;
                let tokens = on_file(&path, Tokens::read).await.flatten()?;
                tracing::info!(tokens = tokens.by_digest.len(), "read {}", path.display());
                (Some((path, first)), tokens)
            }
            None => (None, Tokens::default()),
        };
        Ok(Self { file, tokens: watch::Sender::new(Arc::new(tokens)) })
    }

    /// The caller of a request with these headers to `path`, whose span gets it; an error where access is denied.
    pub fn caller(&self, path: &str, headers: &HeaderMap) -> Result<Option<Caller>> {
        let unknown = || Error::new(Kind::Unauthorized, "the token is not known here: it was mistyped or taken back");
        let tenant = match self.file {
            None => Arc::new(Tenant { name: LOCAL_TENANT.to_owned(), metrics: true, ..Tenant::default() }),
            Some(_) if OPEN.split(' ').any(|open| open == path) => return Ok(None),
            Some(_) => self.tokens.borrow().tenant(bearer(headers)?).ok_or_else(unknown)?,
        };
        let token = tenant.token.as_ref().map(|token| &*token.id);
        tracing::record_all!(tracing::Span::current(), tenant = tenant.name, token);
        if OF_ALL_TENANTS.contains(&path) && !tenant.metrics {
            let message = format_args!(
                "{path} tells about all tenants; the operator makes a token that may read it with `tesserae token new \
                 NAME --metrics`, which this one may not: {}",
                tenant.name
            );
            return Err(Error::new(Kind::Forbidden, message));
        }
        Ok(Some(Caller(tenant)))
    }

    /// Whether a request with these headers may read how the service is, with its paths: it may read metrics, or comes
    /// from this machine, and not through a proxy, where there are no tokens.
    pub fn may_read_details(&self, headers: &HeaderMap, client: IpAddr) -> bool {
        let is_forwarded = ["forwarded", "x-forwarded-for"].iter().any(|name| headers.contains_key(*name));
        match self.file {
            Some(_) => self.caller(OF_ALL_TENANTS[0], headers).is_ok(),
            None => client.is_loopback() && !is_forwarded,
        }
    }

    /// Reads changed tokens within a second or so, until `stop`. Tokens that cannot be read change nothing.
    pub async fn follow(&self, health: &Health, stop: CancellationToken) {
        let Some((path, first)) = &self.file else { return };
        let mut seen = *first;
        while stop.run_until_cancelled(sleep(Duration::from_secs(1))).await.is_some() {
            let Some(now) = on_file(path, stamp).await.ok().filter(|now| *now != seen) else { continue };
            match on_file(path, Tokens::read).await.flatten() {
                Ok(tokens) => {
                    tracing::info!(tokens = tokens.by_digest.len(), "read {} again", path.display());
                    self.tokens.send_replace(Arc::new(tokens));
                    health.clear(Part::Tokens);
                    seen = now;
                }
                // and are read again at the next look
                Err(error) => health.degrade(Part::Tokens, format!("the tokens are as they were before: {error}")),
            }
        }
    }
}

/// What `work` finds in a file, away from the runtime.
async fn on_file<T: Send + 'static>(path: &Path, work: fn(&Path) -> T) -> Result<T> {
    let path = path.to_owned();
    blocking(move || work(&path)).await
}

/// The token of a request (RFC 6750 §2.1).
fn bearer(headers: &HeaderMap) -> Result<&str> {
    let unauthorized = |message| Error::new(Kind::Unauthorized, message);
    let mut values = headers.get_all(header::AUTHORIZATION).iter();
    let (Some(value), None) = (values.next(), values.next()) else {
        return Err(unauthorized("a token is needed, once: send it as `Authorization: Bearer TOKEN`"));
    };
    let (scheme, token) = value.to_str().ok().and_then(|value| value.split_once(' ')).unwrap_or_default();
    match scheme.eq_ignore_ascii_case("bearer") {
        true => Ok(token.trim()),
        false => Err(unauthorized("Authorization must be `Bearer TOKEN`")),
    }
}
