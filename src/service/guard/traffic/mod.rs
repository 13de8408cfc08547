//! Limits of traffic, so that no client takes the service from the others.
//!
//! | limit of | where | beyond it, a client is |
//! |---|---|---|
//! | connections, and how long heads and answers may take | `connections` | closed |
//! | heads that are not valid or not supported | `heads`, hyper | answered with 400, 414, 431 or 501 |
//! | web pages that may not use a service without tokens | `sites` | answered with 403 or 421 |
//! | requests a second, requests and streams at a time | `clients` | answered with 429 |
//! | all streams | [`admit`] | answered with 503 |
//!
//! Limits of the size and the pace of an upload are in `intake`; of waiting jobs, in `queue`.

mod clients;
pub(crate) mod connections;
pub(crate) mod guarded;
pub(crate) mod heads;
pub(crate) mod origin;
pub(crate) mod sites;

use std::net::IpAddr;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tesserae_mesh::error::{Error, Kind};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use self::clients::{Allowance, Client, Clients, Permit};
use self::guarded::Guarded;
use crate::guard::access::{Access, Caller};
use crate::guard::audit;
use crate::guard::path;
use crate::guard::problem::Failure;
use crate::ops::faults::{FaultPoint, Faults};
use crate::ops::trace::Origin;
use crate::settings::{Settings, TrafficSettings};
use crate::store::LOCAL_TENANT;

/// Paths of probes, which get an answer even when their address is over its limits.
const PROBES: [&str; 2] = ["/healthz", "/readyz"];

/// The limits, and what is in use of them.
#[derive(Debug)]
pub(crate) struct Traffic {
    access: Arc<Access>,
    settings: TrafficSettings,
    clients: Arc<Clients>,
    faults: Faults,
    streams: Arc<Semaphore>,
}

impl Traffic {
    pub fn new(settings: &Settings, access: Arc<Access>, faults: Faults) -> Self {
        Self {
            access,
            settings: settings.traffic.clone(),
            clients: Arc::default(),
            faults,
            streams: Arc::new(Semaphore::new(settings.traffic.constants.streams as usize)),
        }
    }

    pub fn open_streams(&self) -> u64 {
        u64::from(self.settings.constants.streams) - self.streams.available_permits() as u64
    }

    fn allowance(&self, caller: Option<&Caller>) -> Allowance {
        let quotas = caller.and_then(|caller| caller.tenant.as_ref()).map(|tenant| tenant.quotas).unwrap_or_default();
        Allowance {
            rate: quotas.max_request_rate.unwrap_or(self.settings.max_request_rate),
            requests: quotas.max_requests_at_once.unwrap_or(self.settings.constants.requests_at_once),
            streams: quotas.max_streams.unwrap_or(self.settings.constants.streams_per_client),
        }
    }
}

/// Finds the caller, and lets the request through when neither that client nor the service is over a limit. The permits
/// of a request are held until its answer was sent.
pub(crate) async fn admit(State(traffic): State<Arc<Traffic>>, mut request: Request, next: Next) -> Response {
    if PROBES.contains(&request.uri().path()) {
        request.extensions_mut().insert(Caller::anybody());
        return next.run(request).await;
    }
    traffic.faults.pass(FaultPoint::Request);
    match check(&traffic, &request) {
        Ok((mut caller, held)) => {
            caller.origin = request.extensions().get::<Origin>().cloned();
            if let Some(tenant) = &caller.tenant {
                tracing::Span::current().record("tenant", &tenant.name);
            }
            request.extensions_mut().insert(caller.clone());
            let mut response = next.run(request).await.map(|body| Body::new(Guarded::new(body, held)));
            // for the layers further out, which count and log the request
            response.extensions_mut().insert(caller);
            response
        }
        Err(failure) => {
            if matches!(failure.error.kind, Kind::Unauthorized | Kind::Forbidden) {
                let origin = request.extensions().get::<Origin>();
                audit::denied(failure.error.kind, request.method(), path::cut(request.uri().path()), origin);
            }
            failure.into_response()
        }
    }
}

/// The permits of a request: its client's, and one of all streams.
type Holding = (Permit, Option<OwnedSemaphorePermit>);

/// The caller of a request, and its permits.
fn check(traffic: &Traffic, request: &Request) -> Result<(Caller, Holding), Failure> {
    let path = request.uri().path();
    let is_stream = request.method() == Method::GET && path.starts_with("/v1/jobs/") && path.ends_with("/events");
    let caller = traffic.access.caller(path, request.headers());
    // a client without a token is known by its address, as is every client of a service without tokens
    let client = match caller.as_ref().ok().and_then(|caller| caller.tenant.as_ref()) {
        Some(tenant) if tenant.name != LOCAL_TENANT => Client::Tenant(tenant.name.clone()),
        _ => {
            let origin = request.extensions().get::<Origin>();
            Client::of_address(origin.map_or(IpAddr::from([0, 0, 0, 0]), |origin| origin.client))
        }
    };
    let permit = traffic.clients.admit(client, traffic.allowance(caller.as_ref().ok()), is_stream)?;
    let caller = caller?;
    let stream = is_stream.then(|| Arc::clone(&traffic.streams).try_acquire_owned()).transpose().map_err(|_| {
        let limit = traffic.settings.constants.streams;
        Error::new(Kind::Overloaded, format_args!("as many event streams are open as may; try again later: {limit}"))
    })?;
    Ok((caller, (permit, stream)))
}
