//! Connections to the database: a pool, and how they fail.

use std::fmt;
use std::iter::successors;
use std::time::Duration;

use deadpool_postgres::{Manager, ManagerConfig, Object, Pool, PoolError, RecyclingMethod};
use rustls::ClientConfig;
use rustls_platform_verifier::BuilderVerifierExt as _;
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::time::{Instant, timeout_at};
use tokio_postgres::Config;
use tokio_postgres::config::SslMode;
use tokio_postgres::error::SqlState;
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
    let failed = || Error::new(Kind::Internal, format_args!("the store of jobs failed: {message} ({})", code.code()));
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
    Error::new(Kind::Unavailable, "the store of jobs cannot be reached; try again later")
}

/// The error of a database that is opened, for the operator.
pub fn cannot_reach(error: Error) -> Error {
    match error.kind {
        Kind::Unavailable => Error::new(
            error.kind,
            "the database that --store names cannot be reached, or takes no connections; --log debug says why",
        ),
        _ => error,
    }
}

#[derive(Debug, Clone)]
pub struct Connections(pub Pool);

impl Connections {
    /// A pool of so many connections, none of which is made yet. The system's certificates verify servers (TLS).
    pub fn new(config: Config, most: usize) -> Result<Self> {
        let manager = ManagerConfig { recycling_method: RecyclingMethod::Fast };
        let manager = match config.get_ssl_mode() {
            SslMode::Disable => Manager::from_config(config, tokio_postgres::NoTls, manager),
            _ => {
                let verified = ClientConfig::builder().with_platform_verifier().map_err(|error| {
                    Error::new(Kind::Io, format_args!("certificates for --store cannot be read: {error}"))
                })?;
                Manager::from_config(config, MakeRustlsConnect::new(verified.with_no_client_auth()), manager)
            }
        };
        let pool = Pool::builder(manager).max_size(most).build();
        pool.map(Self).map_err(|error| Error::new(Kind::Internal, format_args!("no pool of connections: {error}")))
    }

    pub async fn get(&self, deadline: Instant) -> Result<Object, Abort> {
        match timeout_at(deadline, self.0.get()).await {
            Ok(Ok(client)) => Ok(client),
            Ok(Err(PoolError::Backend(error))) => Err(failure(error)),
            Ok(Err(error)) => Err(Abort::Broken(away(&error))),
            Err(_) => Err(self.too_late()),
        }
    }

    /// The database did not answer in time. A connection whose server does not answer would hold up the next work, too:
    /// none is used again.
    pub fn too_late(&self) -> Abort {
        self.0.retain(|_, _| false);
        Abort::Broken(away(&"no answer in time"))
    }
}
