//! Accepts a limited number of connections, and serves each until it ends, hangs or the service closes.
//!
//! A thread of its own accepts connections and looks how each begins. It serves those that begin with a [probe](PROBES)
//! itself, one request each, and hands all others to the threads that answer requests, as long as there are places. So
//! a probe for liveness is answered whatever those threads do, and however many connections they have. The route makes
//! its answer of nothing, and no other request is served here, also not the next one of the same connection.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use axum::Router;
use axum::extract::{ConnectInfo, Request};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Handle};
use tokio::sync::{Semaphore, oneshot};
use tokio::time::timeout;
use tokio_io_timeout::TimeoutWriter;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

use super::{Counts, enter, origin};
use crate::metrics::Metrics;
use crate::settings::{BEGINNINGS, TrafficSettings};

/// For how long nothing is accepted after the system had no means to (too many open files).
const BREATHER: Duration = Duration::from_millis(200);

/// How connections begin that the accepting thread serves.
const PROBES: [&[u8]; 2] = [b"GET /healthz ", b"HEAD /healthz "];

/// Largest head of a probe, in bytes: what the accepting thread parses.
const PROBE_HEAD: usize = 8 << 10;

/// For how long the accepting thread waits for the beginning, which a probe sends at once; and for how long others wait
/// for a place.
const BEGINNING: Duration = Duration::from_secs(1);

/// For how long the rest of a refused body is read and thrown away, so that the answer reaches a client that is still
/// sending: closing at once would reset the connection, and the answer with it.
const LINGER: Duration = Duration::from_secs(2);

/// Serves `router` until `close`; then requests under way are answered first. What this returns completes afterwards,
/// or when the accepting thread ends by a defect.
pub(crate) fn serve(
    listener: TcpListener,
    router: Router,
    settings: TrafficSettings,
    metrics: Arc<Metrics>,
    close: CancellationToken,
) -> io::Result<oneshot::Receiver<()>> {
    let listener = listener.into_std()?;
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let (ended, has_ended) = oneshot::channel();
    let serving = Arc::new(Serving { router, settings, metrics, close, requests: Handle::current() });
    thread::Builder::new().name("accept".to_owned()).spawn(move || {
        runtime.block_on(async {
            match TcpListener::from_std(listener) {
                Ok(listener) => accept(listener, serving).await,
                Err(error) => tracing::error!(%error, "connections cannot be accepted"),
            }
        });
        let _ = ended.send(());
    })?;
    Ok(has_ended)
}

struct Serving {
    router: Router,
    settings: TrafficSettings,
    metrics: Arc<Metrics>,
    close: CancellationToken,
    /// The runtime of the threads that answer requests.
    requests: Handle,
}

/// The accepting thread.
async fn accept(listener: TcpListener, serving: Arc<Serving>) {
    let Serving { settings, metrics, close, .. } = &*serving;
    let tasks = TaskTracker::new();
    let places = Arc::new(Semaphore::new(settings.constants.connections as usize));
    let beginnings = Arc::new(Semaphore::new(BEGINNINGS));
    let by_address = Counts::default();
    loop {
        let accepted = async {
            let beginning = Arc::clone(&beginnings).acquire_owned().await;
            (beginning, listener.accept().await)
        };
        let Some((beginning, accepted)) = close.run_until_cancelled(accepted).await else { break };
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
            false => settings.constants.connections_per_address,
        };
        let Some(counted) = enter(&by_address, ip, limit) else {
            metrics.families.connections_refused.inc();
            continue;
        };
        let _ = stream.set_nodelay(true);
        let (serving, others, places) = (Arc::clone(&serving), tasks.clone(), Arc::clone(&places));
        tasks.spawn(async move {
            let is_probe = serving.close.run_until_cancelled(is_probe(&stream)).await.unwrap_or(false);
            let place = match is_probe {
                true => None,
                false => match timeout(BEGINNING, places.acquire_owned()).await {
                    Ok(place) => place.ok(),
                    Err(_) => {
                        serving.metrics.families.connections_refused.inc();
                        return;
                    }
                },
            };
            drop(beginning);
            let Ok(stream) = stream.into_std() else { return };
            let requests = serving.requests.clone();
            let serve = async move {
                serving.metrics.families.connections.inc();
                connection(stream, address, is_probe, &serving).await;
                serving.metrics.families.connections.dec();
                drop((place, counted));
            };
            match is_probe {
                true => serve.await,
                false => drop(others.spawn_on(serve, &requests)),
            }
        });
    }
    tasks.close();
    tasks.wait().await;
}

/// Whether a connection begins with a probe, whose first bytes come together.
async fn is_probe(stream: &TcpStream) -> bool {
    let mut begun = [0; 16];
    let peeked = timeout(BEGINNING, stream.peek(&mut begun)).await;
    // `serve` meets the same end or error
    peeked.is_ok_and(|bytes| bytes.is_ok()) && PROBES.iter().any(|probe| begun.starts_with(probe))
}

/// Serves one connection; a probe's for one request.
async fn connection(stream: std::net::TcpStream, address: SocketAddr, is_probe: bool, serving: &Serving) {
    let Serving { settings, close, .. } = serving;
    let service = serving.router.clone().map_request(move |mut request: Request<hyper::body::Incoming>| {
        request.extensions_mut().insert(ConnectInfo(address));
        request.map(axum::body::Body::new)
    });
    // from now on, the runtime of this task wakes it
    let Ok(stream) = TcpStream::from_std(stream) else { return };
    let (rest, writer) = stream.into_split();
    let mut writer = Box::pin(TimeoutWriter::new(writer));
    // fails when the client takes nothing for so long
    writer.as_mut().set_timeout_pinned(Some(settings.constants.write_timeout));
    let mut socket = tokio::io::join(rest, writer);
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(settings.constants.header_timeout);
    if is_probe {
        http.keep_alive(false).max_buf_size(PROBE_HEAD);
    }
    let serve = async {
        let io = TokioIo::new(&mut socket);
        let mut connection = std::pin::pin!(http.serve_connection(io, TowerToHyperService::new(service)));
        tokio::select! {
            ended = connection.as_mut() => ended,
            () = close.cancelled() => {
                connection.as_mut().graceful_shutdown();
                connection.await
            }
        }
    };
    if let Err(error) = serve.await {
        tracing::debug!(%error, "a connection ended early");
    }
    // a service that stops does not wait for clients that keep their connections
    tokio::select! {
        biased;
        _ = timeout(LINGER, linger(socket)) => {}
        () = close.cancelled() => {}
    }
}

/// Ends the answers, and reads the rest of what the client sends: not as HTTP, which costs more.
async fn linger(mut socket: impl AsyncRead + AsyncWrite + Unpin) -> io::Result<u64> {
    socket.shutdown().await?;
    tokio::io::copy(&mut socket, &mut tokio::io::sink()).await
}
