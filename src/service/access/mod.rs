//! Authentication: from tokens to tenants.
//!
//! Every request passes [`Access::caller`]; handlers take [`Caller`] and find jobs by it, so that a job of another
//! tenant is not there. Without tokens all requests are of one tenant. A token is never logged, nor part of
//! an error.

mod file;
#[cfg(feature = "postgres")]
mod in_store;
mod place;
pub(super) mod tokens;

use std::net::IpAddr;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use tokio::sync::{Notify, watch};
use tokio_util::sync::CancellationToken;

#[cfg(feature = "postgres")]
pub use self::in_store::{change_tokens, read_tokens};
use self::place::{Place, Stamp};
use self::tokens::{Tenant, TokenName, Tokens};
use super::health::{Health, Part};
use super::problem::Failure;
use super::settings::AccessSettings;
use super::store::fairness::Shares;
use super::store::{LOCAL_TENANT, TokenStore};
use super::trace::Origin;
use crate::error::{Error, Kind, Result};

/// How often is looked whether the tokens changed.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Paths that need no token: those of probes, proxies, readers of the description, and the page; without data of jobs.
const OPEN: [&str; 13] = [
    "/healthz",
    "/readyz",
    "/v1/version",
    "/openapi.yaml",
    "/",
    "/page.js",
    "/scene.js",
    "/page.css",
    "/mark.svg",
    "/share.jpg",
    "/licences.txt",
    "/knot.glb",
    "/knot.tsr",
];

/// The path with data of all tenants.
const METRICS: &str = "/metrics";

/// The sender of a request.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Caller {
    /// The tenant; none for a path that needs no token.
    pub tenant: Option<Tenant>,
    /// Its token, where there are tokens.
    token: Option<TokenName>,
    /// Where the request comes from.
    pub origin: Option<Origin>,
}

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Failure> {
        parts.extensions.get::<Self>().cloned().ok_or_else(|| missing().into())
    }
}

impl Caller {
    /// Name of the tenant; none for a path that needs no token.
    pub fn tenant_name(&self) -> Option<&str> {
        self.tenant.as_ref().map(|tenant| tenant.name.as_str())
    }

    /// The sender of a request that needs no token.
    pub fn anybody() -> Self {
        Self { tenant: None, token: None, origin: None }
    }

    /// Id of its token, where there are tokens.
    pub fn token_id(&self) -> Option<&str> {
        self.token.as_ref().map(TokenName::id)
    }

    /// Refuses callers that may not see and change what is of all tenants.
    pub fn operator(&self) -> Result<()> {
        let tenant = self.tenant()?;
        match tenant.admin {
            true => Ok(()),
            false => Err(Error::new(
                Kind::Forbidden,
                format_args!(
                    "workers have jobs of all tenants; the operator makes a token for them with `tesserae token new \
                     NAME --admin`, which this one is not: {}",
                    tenant.name
                ),
            )),
        }
    }

    /// The tenant whose jobs it may see.
    pub fn tenant(&self) -> Result<&Tenant> {
        self.tenant.as_ref().ok_or_else(missing)
    }
}

/// A handler that needs a tenant at a path that has none.
fn missing() -> Error {
    Error::new(Kind::Internal, "it is not known who asks")
}

/// Finds the callers of requests.
#[derive(Debug)]
pub(super) struct Access {
    kept: Option<Kept>,
    changes: watch::Sender<()>,
    shares: watch::Sender<Arc<Shares>>,
}

/// The tokens, and where they were read from.
#[derive(Debug)]
struct Kept {
    place: Place,
    /// When they were read first.
    first: Option<Stamp>,
    tokens: RwLock<Arc<Tokens>>,
}

impl Kept {
    /// The tokens as they were read last.
    fn tokens(&self) -> Arc<Tokens> {
        Arc::clone(&self.tokens.read().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Access {
    /// Reads the tokens, if there are to be some: of a file, or of the store where the settings say so.
    pub async fn open(settings: &AccessSettings, store: Option<Arc<dyn TokenStore>>) -> Result<Self> {
        let place = match (&settings.tokens, store.filter(|_| settings.tokens_in_store)) {
            (Some(path), _) => Some(Place::File(path.clone())),
            (None, store) => store.map(Place::Store),
        };
        let kept = match place {
            Some(place) => {
                // before they are read: what changes meanwhile is read again
                let first = place.stamp().await;
                let tokens = Arc::new(place.read().await?);
                tracing::info!(tokens = tokens.len(), "read {}", place.name());
                Some(Kept { place, first, tokens: RwLock::new(tokens) })
            }
            None => None,
        };
        let shares = kept.as_ref().map(|kept| kept.tokens().shares()).unwrap_or_default();
        Ok(Self { kept, changes: watch::Sender::default(), shares: watch::Sender::new(Arc::new(shares)) })
    }

    /// What each tenant may use of the queue, as the tokens say now.
    pub fn shares(&self) -> watch::Receiver<Arc<Shares>> {
        self.shares.subscribe()
    }

    /// The caller of a request with these headers to `path`; an error where access is denied.
    pub fn caller(&self, path: &str, headers: &HeaderMap) -> Result<Caller> {
        let Some(kept) = &self.kept else {
            let local =
                Tenant { name: LOCAL_TENANT.to_owned(), quotas: Default::default(), metrics: true, admin: true };
            return Ok(Caller { tenant: Some(local), token: None, origin: None });
        };
        if OPEN.contains(&path) {
            return Ok(Caller::anybody());
        }
        let tokens = kept.tokens();
        let (tenant, token) = tokens.tenant(bearer(headers)?).ok_or_else(|| {
            Error::new(Kind::Unauthorized, "the token is not known here: it was mistyped or taken back")
        })?;
        if path == METRICS && !tenant.metrics {
            return Err(Error::new(
                Kind::Forbidden,
                format_args!(
                    "metrics tell about all tenants; the operator makes a token that may read them with `tesserae \
                     token new NAME --metrics`, which this one may not: {}",
                    tenant.name
                ),
            ));
        }
        Ok(Caller { tenant: Some(tenant.clone()), token: Some(token), origin: None })
    }

    /// Whether a request with these headers may read how the service is, with its paths: it may read metrics, or comes
    /// from this machine, and not through a proxy, where there are no tokens.
    pub fn may_read_details(&self, headers: &HeaderMap, client: IpAddr) -> bool {
        match self.kept {
            Some(_) => self.caller(METRICS, headers).is_ok(),
            None => {
                client.is_loopback() && !["forwarded", "x-forwarded-for"].iter().any(|name| headers.contains_key(*name))
            }
        }
    }

    /// Whether the token of an earlier caller is still valid.
    pub fn still_knows(&self, caller: &Caller) -> bool {
        let (Some(kept), Some(token), Some(tenant)) = (&self.kept, &caller.token, &caller.tenant) else {
            return true;
        };
        kept.tokens().has(token, &tenant.name)
    }

    /// Changes whenever the tokens may have.
    pub fn changes(&self) -> watch::Receiver<()> {
        let mut changes = self.changes.subscribe();
        // what changed since the caller was let in is not missed
        changes.mark_changed();
        changes
    }

    /// Reads the tokens again whenever they change, and when `reload` is notified, until `stop`. Tokens that cannot be
    /// read change nothing.
    pub async fn follow(&self, health: &Health, reload: Arc<Notify>, stop: CancellationToken) {
        let Some(kept) = &self.kept else { return };
        let mut seen = kept.first.clone();
        loop {
            let is_asked = tokio::select! {
                () = stop.cancelled() => return,
                () = tokio::time::sleep(LOOK_EVERY) => false,
                () = reload.notified() => true,
            };
            let stamp = kept.place.stamp().await;
            // a store that is away shows in the health of the store
            if !is_asked && (stamp.is_none() || stamp == seen) {
                continue;
            }
            match kept.place.read().await {
                Ok(tokens) => {
                    tracing::info!(tokens = tokens.len(), "read {} again", kept.place.name());
                    self.shares.send_replace(Arc::new(tokens.shares()));
                    *kept.tokens.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(tokens);
                    self.changes.send_replace(());
                    health.clear(Part::Tokens);
                    seen = stamp;
                }
                // and are read again at the next look
                Err(error) => health.degrade(Part::Tokens, format!("the tokens are as they were before: {error}")),
            }
        }
    }
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use async_trait::async_trait;
    use serde_json::json;

    use super::*;
    use crate::service::store::TokenRows;

    /// A store whose rows cannot be read a few times.
    #[derive(Debug, Default)]
    struct Rows {
        version: AtomicU64,
        failures: AtomicU64,
    }

    #[async_trait]
    impl TokenStore for Rows {
        async fn token_version(&self) -> Result<u64> {
            Ok(self.version.load(Ordering::SeqCst))
        }

        async fn token_rows(&self) -> Result<TokenRows> {
            let fails = self.failures.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
            if fails.is_ok() {
                return Err(Error::new(Kind::Unavailable, "away"));
            }
            let entry = json!({"quotas": {"weight": 1 + self.token_version().await?}});
            Ok(TokenRows::from([("acme".to_owned(), entry)]))
        }
    }

    #[tokio::test]
    async fn a_change_of_tokens_that_could_not_be_read_once_is_read_at_the_next_look() {
        let rows = Arc::new(Rows::default());
        let settings = AccessSettings { tokens_in_store: true, ..AccessSettings::default() };
        let access = Access::open(&settings, Some(rows.clone())).await.expect("opened");
        let (health, stop) = (Health::default(), CancellationToken::new());
        let mut shares = access.shares();
        assert_eq!(shares.borrow_and_update().of("acme").weight, 1);
        rows.failures.store(1, Ordering::SeqCst);
        rows.version.store(1, Ordering::SeqCst);
        let read = async {
            tokio::time::timeout(Duration::from_secs(60), shares.changed()).await.expect("in time").expect("followed");
            assert_eq!(shares.borrow().of("acme").weight, 2);
            stop.cancel();
        };
        tokio::join!(access.follow(&health, Arc::default(), stop.clone()), read);
        assert_eq!(rows.failures.load(Ordering::SeqCst), 0, "it was read twice");
        assert!(health.conditions().is_empty(), "and is in order again");
    }
}
