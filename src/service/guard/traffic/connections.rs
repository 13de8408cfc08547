//! Accepts a limited number of connections, and serves each until it ends, hangs or the service closes.
//!
//! A thread of its own accepts connections and looks how each begins. It serves probes for liveness itself, one request
//! each, and hands all others to the threads that answer requests, as long as there are places. So a probe is answered
//! whatever those threads do, and however many connections they have. The route makes its answer of nothing, and no
//! other request is served here, also not the next one of the same connection.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use axum::Router;
use axum::extract::{ConnectInfo, Request};
use futures_util::future::OptionFuture;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::AsyncWriteExt as _;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Handle, Runtime};
use tokio::sync::{Semaphore, oneshot};
use tokio::time::timeout;
use tokio_io_timeout::TimeoutWriter;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

use super::{Counts, enter, origin};
use crate::metrics::Metrics;
use crate::settings::{BEGINNINGS, TrafficSettings};

/// Longest wait of the accepting thread for the beginning, which a probe sends at once; of others, for a place.
const BEGINNING: Duration = Duration::from_secs(1);

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
    let (ended, has_ended) = oneshot::channel();
    let serving = Arc::new(Serving { router, settings, metrics, close, requests: Handle::current() });
    let (give, take) = mpsc::channel::<Runtime>();
    thread::Builder::new().name("accept".to_owned()).spawn(move || {
        if let Ok(Err(error)) = take.recv().map(|runtime| runtime.block_on(accept(listener, serving))) {
            tracing::error!(%error, "connections cannot be accepted");
        }
        let _ = ended.send(());
    })?;
    // made now: where the thread does not start, it would be dropped within another runtime, which panics
    let _ = give.send(Builder::new_current_thread().enable_all().build()?);
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

async fn accept(listener: std::net::TcpListener, serving: Arc<Serving>) -> io::Result<()> {
    let listener = TcpListener::from_std(listener)?;
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
                // the client gave up, or there are too many open files, of which some may be closed soon
                tracing::warn!(%error, "a connection cannot be accepted");
                tokio::time::sleep(Duration::from_millis(200)).await;
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
            let place = OptionFuture::from((!is_probe).then(|| timeout(BEGINNING, places.acquire_owned()))).await;
            if place.as_ref().is_some_and(Result::is_err) {
                serving.metrics.families.connections_refused.inc();
                return;
            }
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
    Ok(())
}

/// Whether a connection begins with a probe, whose first bytes come together.
async fn is_probe(stream: &TcpStream) -> bool {
    let mut begun = [0; 16];
    let peeked = timeout(BEGINNING, stream.peek(&mut begun)).await;
    // `serve` meets the same end or error
    let has_begun = peeked.is_ok_and(|bytes| bytes.is_ok());
    has_begun && (begun.starts_with(b"GET /healthz ") || begun.starts_with(b"HEAD /healthz "))
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
        // bytes of its head, which the accepting thread parses
        http.keep_alive(false).max_buf_size(8 << 10);
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
    // Reads the rest of a refused body, so that the answer reaches a client that is still sending: closing at once
    // would reset the connection, and the answer with it. Reading it as HTTP would cost more.
    let linger = async {
        socket.shutdown().await?;
        tokio::io::copy(&mut socket, &mut tokio::io::sink()).await
    };
    // a service that stops does not wait for clients that keep their connections
    tokio::select! {
        biased;
        _ = timeout(Duration::from_secs(2), linger) => {}
        () = close.cancelled() => {}
    }
}
