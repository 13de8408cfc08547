//! Connections to the database: a pool, and how they fail.
//!
//! A thread that waits for an answer drives the connection itself, in a runtime of that connection. A task of the
//! service's runtime would do so on another thread, so that every answer would wake two threads, one after the other:
//! that takes longer than most statements.

use std::collections::HashMap;
use std::fmt;
use std::iter::successors;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use futures_util::future::{BoxFuture, Fuse, FutureExt as _, poll_fn};
use parking_lot::Mutex;
use rustls::ClientConfig;
use rustls_platform_verifier::BuilderVerifierExt as _;
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::yield_now;
use tokio::time::{Instant, timeout_at};
use tokio_postgres::config::SslMode;
use tokio_postgres::error::SqlState;
use tokio_postgres::{Client, Config, NoTls, Socket, Statement};
use tokio_postgres_rustls::MakeRustlsConnect;

use super::super::Abort;

/// Time for a piece of work, the wait for a connection included.
pub const PATIENCE: Duration = Duration::from_secs(10);

/// Why a transaction ended: clients get no more than the kind; the log says the rest.
pub fn failure(error: tokio_postgres::Error) -> Abort {
    let Some(database) = error.as_db_error() else {
        let causes = successors(Some(&error as &dyn std::error::Error), |error| error.source());
        return Abort::Broken(away(&causes.map(ToString::to_string).collect::<Vec<_>>().join(": ")));
    };
    let (code, message) = (database.code(), database.message());
    let failed = || Error::internal(format_args!("the store of jobs failed: {message} ({})", code.code()));
    if [SqlState::T_R_DEADLOCK_DETECTED, SqlState::T_R_SERIALIZATION_FAILURE].contains(code) {
        return Abort::Again(failed());
    }
    Abort::Broken(match code.code().get(..2).unwrap_or_default() {
        "53" if *code == SqlState::DISK_FULL => {
            Error::new(Kind::InsufficientStorage, "the disk of the store of jobs is full")
        }
        // no connection, no resources, stopped by the operator, or not started yet
        "08" | "57" | "25" | "55" | "53" => away(&message),
        _ => failed(),
    })
}

fn away(why: &dyn fmt::Display) -> Error {
    tracing::debug!(%why, "the store of jobs cannot be reached");
    Error::unavailable("the store of jobs cannot be reached; try again later")
}

/// The error of a database that is opened, for the operator.
pub fn cannot_reach(error: Error) -> Error {
    match error.kind {
        Kind::Unavailable => Error::unavailable(
            "the database that --store names cannot be reached, or takes no connections; --log debug says why",
        ),
        _ => error,
    }
}

/// A runtime whose end waits for nothing, such as a name that is looked up.
struct OwnRuntime(Option<Runtime>);

impl OwnRuntime {
    /// Waits on this thread for the end of work; none when the deadline has passed.
    fn until<T>(&self, deadline: Instant, work: impl Future<Output = T>) -> Option<T> {
        self.0.as_ref()?.block_on(async { timeout_at(deadline, work).await.ok() })
    }
}

impl Drop for OwnRuntime {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

/// A connection with the statements that are prepared on it. It sends and receives while a thread [waits](Self::wait).
pub struct Connection {
    /// Present until the end.
    client: Option<Client>,
    statements: HashMap<&'static str, Statement>,
    /// Ends when the connection is closed.
    driver: Fuse<BoxFuture<'static, ()>>,
    runtime: OwnRuntime,
}

impl Drop for Connection {
    fn drop(&mut self) {
        // without a client, the driver tells the server the end
        self.client = None;
        let _: Option<()> = (&mut self.driver).now_or_never();
    }
}

impl Connection {
    /// Waits on this thread for the end of work with the connection; none when the deadline has passed.
    pub fn wait<T>(
        &mut self,
        deadline: Instant,
        work: impl AsyncFnOnce(&mut Client, &mut HashMap<&'static str, Statement>) -> T,
    ) -> Option<T> {
        let Self { client, statements, driver, runtime } = self;
        let mut work = pin!(work(client.as_mut()?, statements));
        let driven = poll_fn(|context| {
            // work that waits for a connection that is closed fails
            let _: Poll<()> = driver.poll_unpin(context);
            work.as_mut().poll(context)
        });
        runtime.until(deadline, driven)
    }

    /// Whether the server has left it open since it was used last.
    fn is_open(&mut self, deadline: Instant) -> bool {
        let is_closed = self.wait(deadline, async |client, _| {
            // the driver notices it in this turn of the runtime
            yield_now().await;
            client.is_closed()
        });
        is_closed == Some(false)
    }
}

#[derive(Clone)]
pub struct Connections {
    config: Arc<Config>,
    /// None where connections are not encrypted.
    tls: Option<MakeRustlsConnect>,
    /// Open, and not in use.
    idle: Arc<Mutex<Vec<Connection>>>,
    permits: Arc<Semaphore>,
}

impl Connections {
    /// A pool of so many connections, none of which is made yet. The system's certificates verify servers (TLS).
    pub fn new(config: Config, most: usize) -> Result<Self> {
        let tls = match config.get_ssl_mode() {
            SslMode::Disable => None,
            _ => {
                let verified = ClientConfig::builder().with_platform_verifier().map_err(|error| {
                    Error::new(Kind::Io, format_args!("certificates for --store cannot be read: {error}"))
                })?;
                Some(MakeRustlsConnect::new(verified.with_no_client_auth()))
            }
        };
        let permits = Arc::new(Semaphore::new(most));
        Ok(Self { config: Arc::new(config), tls, idle: Arc::default(), permits })
    }

    /// Waits until a connection may be used.
    pub async fn permit(&self, deadline: Instant) -> Result<OwnedSemaphorePermit> {
        match timeout_at(deadline, Arc::clone(&self.permits).acquire_owned()).await {
            Ok(Ok(permit)) => Ok(permit),
            Ok(Err(closed)) => Err(away(&closed)),
            Err(_) => Err(away(&"all connections are in use")),
        }
    }

    /// A connection, for the holder of a permit. To be called where blocking is allowed.
    pub fn get(&self, deadline: Instant) -> Result<Connection, Abort> {
        loop {
            if Instant::now() >= deadline {
                return Err(Abort::Broken(away(&"the time for this work is over")));
            }
            let Some(mut idle) = self.idle.lock().pop() else { return self.connect(deadline) };
            if idle.is_open(deadline) {
                return Ok(idle);
            }
        }
    }

    fn connect(&self, deadline: Instant) -> Result<Connection, Abort> {
        let runtime = Builder::new_current_thread().enable_all().build();
        let runtime = OwnRuntime(Some(runtime.map_err(|error| Abort::Broken(away(&error)))?));
        let connected = runtime.until(deadline, async {
            Ok(match &self.tls {
                None => driven(self.config.connect(NoTls).await?),
                Some(tls) => driven(self.config.connect(tls.clone()).await?),
            })
        });
        let (client, driver) = connected.ok_or_else(|| self.too_late())?.map_err(failure)?;
        Ok(Connection { client: Some(client), statements: HashMap::new(), driver: driver.fuse(), runtime })
    }

    /// Keeps a connection for the next work.
    pub fn put(&self, connection: Connection) {
        let mut idle = self.idle.lock();
        if !self.permits.is_closed() {
            idle.push(connection);
        }
    }

    /// The database did not answer in time. A connection whose server does not answer would hold up the next work, too:
    /// none is used again.
    pub fn too_late(&self) -> Abort {
        self.idle.lock().clear();
        Abort::Broken(away(&"no answer in time"))
    }

    /// Work that begins from now on gets no connection, and none is kept.
    pub fn close(&self) {
        self.permits.close();
        self.idle.lock().clear();
    }
}

/// A client, and what sends and receives for it.
fn driven<S>((client, connection): (Client, tokio_postgres::Connection<Socket, S>)) -> (Client, BoxFuture<'static, ()>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let driver =
        connection.map(|end| end.unwrap_or_else(|why| tracing::debug!(%why, "a connection to the store ended")));
    (client, driver.boxed())
}
