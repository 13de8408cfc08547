//! Limits of traffic, so that no client takes the service from the others.
//!
//! | limit of | where | beyond it, a client is |
//! |---|---|---|
//! | connections, and how long heads and answers may take | `connections` | closed |
//! | heads that are not valid or not supported | `heads`, hyper | answered with 400, 414, 431 or 501 |
//! | web pages that may not use a service without tokens | `heads` | answered with 403 or 421 |
//! | requests and streams of a client at a time | [`admit`] | answered with 429 |
//! | all streams | [`admit`] | answered with 503 |
//!
//! Limits of the size and the pace of an upload are in `intake`; of waiting jobs, in `queue`.

pub(crate) mod connections;
pub(crate) mod heads;
pub(crate) mod origin;

use std::collections::HashMap;
use std::hash::Hash;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::Method;
use axum::middleware::Next;
use http_body_util::BodyExt as _;
use parking_lot::Mutex;
use tesserae_mesh::error::{Error, Kind};
use tokio::sync::Semaphore;

use crate::guard::access::{Access, Caller};
use crate::guard::problem::{Answer, Failure};
use crate::ops::faults::{FaultPoint, Faults};
use crate::ops::trace::Origin;
use crate::settings::{Settings, TrafficSettings};
use crate::store::LOCAL_TENANT;

#[derive(Debug)]
pub(crate) struct Traffic {
    access: Arc<Access>,
    settings: TrafficSettings,
    faults: Faults,
    requests: Counts<Client>,
    client_streams: Counts<Client>,
    streams: Arc<Semaphore>,
}

/// A client: its requests share one allowance.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Client {
    Tenant(String),
    /// An address: of IPv6, the first half, which is what one machine has to itself.
    Address(IpAddr),
}

impl Client {
    fn of_address(address: IpAddr) -> Self {
        Self::Address(match address.to_canonical() {
            IpAddr::V6(address) => IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() >> 64 << 64)),
            v4 @ IpAddr::V4(_) => v4,
        })
    }
}

impl Traffic {
    pub fn new(settings: &Settings, access: Arc<Access>, faults: Faults) -> Self {
        Self {
            access,
            settings: settings.traffic.clone(),
            faults,
            requests: Counts::default(),
            client_streams: Counts::default(),
            streams: Arc::new(Semaphore::new(settings.traffic.constants.streams as usize)),
        }
    }

    pub fn open_streams(&self) -> u64 {
        u64::from(self.settings.constants.streams) - self.streams.available_permits() as u64
    }
}

/// Finds the caller, and lets the request through when neither that client nor the service is over a limit. Its permits
/// are held until its answer was sent. Probes need none, so that they are answered whatever their address does.
pub(crate) async fn admit(State(traffic): State<Arc<Traffic>>, mut request: Request, next: Next) -> Answer {
    if ["/healthz", "/readyz"].contains(&request.uri().path()) {
        return Ok(next.run(request).await);
    }
    traffic.faults.pass(FaultPoint::Request);
    let (caller, held) = check(&traffic, &request)?;
    if let Some(caller) = caller {
        request.extensions_mut().insert(caller);
    }
    // the closure owns what is held, which so ends with the body
    Ok(next.run(request).await.map(|body| {
        Body::new(body.map_err(move |error| {
            let _held_with_the_body = &held;
            error
        }))
    }))
}

/// The caller of a request, and its permits: its client's, and of a stream one of all streams.
fn check(traffic: &Traffic, request: &Request) -> Result<(Option<Caller>, impl Send + use<>), Failure> {
    let path = request.uri().path();
    let is_stream = request.method() == Method::GET && path.starts_with("/v1/jobs/") && path.ends_with("/events");
    let caller = traffic.access.caller(path, request.headers());
    // a client without a token is known by its address, as is every client of a service without tokens
    let tenant = caller.as_ref().ok().and_then(Option::as_ref).map(|caller| &caller.0);
    let client = match tenant {
        Some(tenant) if tenant.name != LOCAL_TENANT => Client::Tenant(tenant.name.clone()),
        _ => {
            let origin = request.extensions().get::<Origin>();
            Client::of_address(origin.map_or(IpAddr::from([0, 0, 0, 0]), |origin| origin.client))
        }
    };
    let (quotas, constants) = (tenant.map(|tenant| tenant.quotas).unwrap_or_default(), &traffic.settings.constants);
    let (counts, limit, what) = match is_stream {
        true => (&traffic.client_streams, quotas.max_streams.unwrap_or(constants.streams_per_client), "event streams"),
        false => (&traffic.requests, quotas.max_requests_at_once.unwrap_or(constants.requests_at_once), "requests"),
    };
    let Some(permit) = enter(counts, client, limit) else {
        let message = format_args!("as many {what} at a time as a client may have; try again later: {limit}");
        return Err(Error::new(Kind::RateLimited, message).into());
    };
    let caller = caller?;
    let stream = is_stream.then(|| Arc::clone(&traffic.streams).try_acquire_owned()).transpose().map_err(|_| {
        let limit = constants.streams;
        Error::new(Kind::Overloaded, format_args!("as many event streams are open as may; try again later: {limit}"))
    })?;
    Ok((caller, (permit, stream)))
}

/// How many of something each client has at a time, none of them 0.
type Counts<K> = Arc<Mutex<HashMap<K, u32>>>;

/// One that is counted until this is dropped.
struct Counted<K: Hash + Eq> {
    counts: Counts<K>,
    key: K,
}

/// Counts one more, unless there are as many as may be.
fn enter<K: Hash + Eq + Clone>(counts: &Counts<K>, key: K, limit: u32) -> Option<Counted<K>> {
    let mut locked = counts.lock();
    if locked.get(&key).copied().unwrap_or_default() >= limit {
        return None;
    }
    *locked.entry(key.clone()).or_default() += 1;
    Some(Counted { counts: Arc::clone(counts), key })
}

impl<K: Hash + Eq> Drop for Counted<K> {
    fn drop(&mut self) {
        let mut counts = self.counts.lock();
        if let Some(count) = counts.get_mut(&self.key) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.key);
            }
        }
    }
}

#[cfg(test)]
#[test]
fn an_ipv6_machine_is_one_client_under_all_its_addresses() {
    let of = |text: &str| Client::of_address(text.parse().expect("an address"));
    assert_eq!(of("2001:db8:1:2::1"), of("2001:db8:1:2:ffff::9"));
    assert_ne!(of("2001:db8:1:2::1"), of("2001:db8:1:3::1"));
    assert_eq!(of("::ffff:10.0.0.1"), of("10.0.0.1"));
}
