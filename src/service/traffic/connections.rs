//! Accepts a limited number of connections, and serves each until it ends, hangs or the service closes.

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{ConnectInfo, Request};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use parking_lot::Mutex;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

use super::origin;
use super::socket::Socket;
use crate::service::metrics::Metrics;
use crate::service::settings::TrafficSettings;

/// For how long nothing is accepted after the system had no means to (too many open files).
const BREATHER: Duration = Duration::from_millis(200);

/// Serves `router` until `close`; then requests under way are answered first.
pub(in crate::service) async fn serve(
    listener: TcpListener,
    router: Router,
    settings: TrafficSettings,
    metrics: Arc<Metrics>,
    close: CancellationToken,
) {
    let tasks = TaskTracker::new();
    let places = Arc::new(Semaphore::new(settings.max_connections as usize));
    let by_address = Arc::new(ByAddress::default());
    loop {
        let accepted = async {
            let place = Arc::clone(&places).acquire_owned().await;
            (place, listener.accept().await)
        };
        let Some((place, accepted)) = close.run_until_cancelled(accepted).await else { break };
        let (stream, address) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                // the client gave up, or there are too many open files
                tracing::warn!(%error, "a connection cannot be accepted");
                tokio::time::sleep(BREATHER).await;
                continue;
            }
        };
        let ip = address.ip().to_canonical();
        // a proxy brings the connections of many clients
        let limit = match origin::is_proxy(ip, &settings.trusted_proxies) {
            true => u32::MAX,
            false => settings.max_connections_per_address,
        };
        let Some(counted) = by_address.enter(ip, limit) else {
            metrics.connection_refused();
            continue;
        };
        let _ = stream.set_nodelay(true);
        let connection = connection(stream, address, router.clone(), &settings, close.clone());
        let metrics = Arc::clone(&metrics);
        tasks.spawn(async move {
            metrics.connections(1);
            connection.await;
            metrics.connections(-1);
            drop((place, counted));
        });
    }
    tasks.close();
    tasks.wait().await;
}

/// Serves one connection.
fn connection(
    stream: TcpStream,
    address: SocketAddr,
    router: Router,
    settings: &TrafficSettings,
    close: CancellationToken,
) -> impl Future<Output = ()> + Send + use<> {
    let service = router.map_request(move |mut request: Request<hyper::body::Incoming>| {
        request.extensions_mut().insert(ConnectInfo(address));
        request.map(axum::body::Body::new)
    });
    let socket = TokioIo::new(Socket::new(stream, settings.write_timeout()));
    let header_timeout = settings.header_timeout();
    async move {
        let mut connection = std::pin::pin!(
            http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(header_timeout)
                .serve_connection(socket, TowerToHyperService::new(service))
        );
        let ended = tokio::select! {
            ended = connection.as_mut() => ended,
            () = close.cancelled() => {
                connection.as_mut().graceful_shutdown();
                connection.await
            }
        };
        if let Err(error) = ended {
            tracing::debug!(%error, "a connection ended early");
        }
    }
}

/// Connections that are open, by the address at the other end.
#[derive(Debug, Default)]
struct ByAddress(Mutex<HashMap<IpAddr, u32>>);

/// A connection that is counted until this is dropped.
#[derive(Debug)]
struct Counted {
    counts: Arc<ByAddress>,
    address: IpAddr,
}

impl ByAddress {
    /// Counts one more, unless there are as many as may be.
    fn enter(self: &Arc<Self>, address: IpAddr, limit: u32) -> Option<Counted> {
        let mut counts = self.0.lock();
        let count = counts.entry(address).or_default();
        if *count >= limit {
            return None;
        }
        *count += 1;
        Some(Counted { counts: Arc::clone(self), address })
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        let mut counts = self.counts.0.lock();
        if let Some(count) = counts.get_mut(&self.address) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.address);
            }
        }
    }
}
