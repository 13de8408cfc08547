//! Connections to the database: a pool, and how work on one of them fails.
//!
//! Work that takes longer than [`PATIENCE`] fails as if the database were away, and takes the pool's connections with
//! it: one whose server does not answer would hold up the next work, too. Work that the database broke off for the sake
//! of other work (a deadlock) is done again, and so is work whose prepared statements are of tables that a service of
//! the next release has changed since: on new connections, which prepare them anew.

use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use deadpool_postgres::{GenericClient, Manager, ManagerConfig, Object, Pool, PoolError, RecyclingMethod};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use rustls::{ClientConfig, RootCertStore};
use rustls_platform_verifier::BuilderVerifierExt as _;
use tokio_postgres::Row;
use tokio_postgres::error::SqlState;
use tokio_postgres::types::ToSql;
use tokio_postgres_rustls::MakeRustlsConnect;

use super::super::Statistics;
use super::address::Address;
use crate::error::{Error, Kind, Result};

/// Time for a piece of work, the wait for a connection included.
pub(super) const PATIENCE: Duration = Duration::from_secs(10);

/// Times that work is done again that the database broke off, though nothing is wrong with it.
const AGAIN: usize = 5;

/// Why a piece of work failed.
#[derive(Debug)]
pub(super) enum Failure {
    /// The database failed.
    Database(tokio_postgres::Error),
    /// No connection can be had.
    Pool(PoolError),
    /// It is refused.
    Refused(Error),
}

impl From<tokio_postgres::Error> for Failure {
    fn from(error: tokio_postgres::Error) -> Self {
        Self::Database(error)
    }
}

impl From<PoolError> for Failure {
    fn from(error: PoolError) -> Self {
        Self::Pool(error)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

impl Failure {
    /// Whether the same work may be done at once.
    fn is_of_others(&self) -> bool {
        let broken_off = [&SqlState::T_R_DEADLOCK_DETECTED, &SqlState::T_R_SERIALIZATION_FAILURE];
        matches!(self, Self::Database(error) if error.code().is_some_and(|code| broken_off.contains(&code)))
    }
}

impl Failure {
    /// Whether the connection has statements of tables that have other columns now.
    fn is_of_old_statements(&self) -> bool {
        let Self::Database(error) = self else { return false };
        error.as_db_error().is_some_and(|error| {
            *error.code() == SqlState::FEATURE_NOT_SUPPORTED && error.message().starts_with("cached plan")
        })
    }
}

impl From<Failure> for Error {
    /// Clients get no more than the kind; the log says the rest.
    fn from(failure: Failure) -> Self {
        let error = match failure {
            Failure::Refused(error) => return error,
            Failure::Pool(PoolError::Backend(error)) => error,
            Failure::Pool(error) => return away(&error),
            Failure::Database(error) => error,
        };
        let Some(database) = error.as_db_error() else { return away(&Causes(&error)) };
        let code = database.code().code();
        match code.get(..2).unwrap_or_default() {
            // no connection, no resources, stopped by the operator, or not started yet
            "08" | "57" | "25" | "55" => away(&database.message()),
            "53" if *database.code() == SqlState::DISK_FULL => {
                Self::new(Kind::InsufficientStorage, "the disk of the store of jobs is full")
            }
            "53" => away(&database.message()),
            _ => Self::new(Kind::Internal, format_args!("the store of jobs failed: {} ({code})", database.message())),
        }
    }
}

/// An error with what caused it.
struct Causes<'e>(&'e dyn std::error::Error);

impl fmt::Display for Causes<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)?;
        let mut cause = self.0.source();
        while let Some(error) = cause {
            write!(f, ": {error}")?;
            cause = error.source();
        }
        Ok(())
    }
}

/// The error of a database that does not answer.
fn away(why: &dyn fmt::Display) -> Error {
    tracing::debug!(%why, "the store of jobs cannot be reached");
    Error::new(Kind::Unavailable, "the store of jobs cannot be reached; try again later")
}

/// The error of a database that is opened, for the operator.
pub(super) fn cannot_reach(error: Error) -> Error {
    match error.kind {
        Kind::Unavailable => Error::new(
            error.kind,
            "the database that --store names cannot be reached, or takes no connections; --log debug says why",
        ),
        _ => error,
    }
}

/// The pool, and what was done with it.
#[derive(Debug)]
pub(super) struct Connections {
    pool: Pool,
    commits: AtomicU64,
    failures: AtomicU64,
    micros: AtomicU64,
}

impl Connections {
    /// A pool of so many connections, none of which is made yet.
    pub fn new(address: &Address, most: usize) -> Result<Self> {
        let manager = ManagerConfig { recycling_method: RecyclingMethod::Fast };
        let config = address.config.clone();
        let manager = match encryption(address)? {
            Some(tls) => Manager::from_config(config, tls, manager),
            None => Manager::from_config(config, tokio_postgres::NoTls, manager),
        };
        let pool = Pool::builder(manager).max_size(most).build();
        let pool = pool.map_err(|error| Error::new(Kind::Internal, format_args!("no pool of connections: {error}")))?;
        Ok(Self { pool, commits: AtomicU64::new(0), failures: AtomicU64::new(0), micros: AtomicU64::new(0) })
    }

    /// Does a piece of work on a connection.
    pub async fn run<T, F>(&self, work: impl Fn(Object) -> F + Send) -> Result<T>
    where
        F: Future<Output = Result<T, Failure>> + Send,
    {
        let started = Instant::now();
        let attempts = async {
            let mut left = AGAIN;
            loop {
                match work(self.pool.get().await?).await {
                    Err(failure) if failure.is_of_others() && left > 0 => left -= 1,
                    Err(failure) if failure.is_of_old_statements() && left > 0 => {
                        left -= 1;
                        self.pool.retain(|_, _| false);
                    }
                    outcome => return outcome,
                }
            }
        };
        let outcome = match tokio::time::timeout(PATIENCE, attempts).await {
            Ok(outcome) => outcome.map_err(Error::from),
            Err(_) => {
                self.pool.retain(|_, _| false);
                Err(away(&"no answer in time"))
            }
        };
        self.commits.fetch_add(1, Ordering::Relaxed);
        self.micros.fetch_add(started.elapsed().as_micros() as u64, Ordering::Relaxed);
        if outcome.as_ref().is_err_and(|error| error.is_of_storage() || error.kind == Kind::Internal) {
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
        outcome
    }

    /// What was done.
    pub fn statistics(&self) -> Statistics {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Statistics {
            commits: count(&self.commits),
            commands: count(&self.commits),
            failures: count(&self.failures),
            commit_seconds: count(&self.micros) as f64 / 1e6,
            ..Statistics::default()
        }
    }

    /// Closes all connections.
    pub fn close(&self) {
        self.pool.close();
    }
}

/// How connections are encrypted; none when they are not.
pub(super) fn encryption(address: &Address) -> Result<Option<MakeRustlsConnect>> {
    if !address.is_encrypted {
        return Ok(None);
    }
    let cannot = |error: &dyn fmt::Display| {
        Error::new(Kind::Io, format_args!("certificates for --store cannot be read: {error}"))
    };
    let config = match &address.authorities {
        Some(path) => {
            let mut roots = RootCertStore::empty();
            let found = CertificateDer::pem_file_iter(path).map_err(|error| cannot(&error))?;
            for certificate in found {
                let certificate = certificate.map_err(|error| cannot(&error))?;
                roots.add(certificate).map_err(|error| cannot(&error))?;
            }
            ClientConfig::builder().with_root_certificates(roots).with_no_client_auth()
        }
        None => {
            let builder = ClientConfig::builder().with_platform_verifier().map_err(|error| cannot(&error))?;
            builder.with_no_client_auth()
        }
    };
    Ok(Some(MakeRustlsConnect::new(config)))
}

/// All rows of a query.
pub(super) async fn all(
    client: &impl GenericClient,
    sql: &str,
    parameters: &[&(dyn ToSql + Sync)],
) -> Result<Vec<Row>, Failure> {
    let statement = client.prepare_cached(sql).await?;
    Ok(client.query(&statement, parameters).await?)
}

/// The only row of a query, if there is one.
pub(super) async fn first(
    client: &impl GenericClient,
    sql: &str,
    parameters: &[&(dyn ToSql + Sync)],
) -> Result<Option<Row>, Failure> {
    let statement = client.prepare_cached(sql).await?;
    Ok(client.query_opt(&statement, parameters).await?)
}

/// The only row of a query that always has one.
pub(super) async fn one(
    client: &impl GenericClient,
    sql: &str,
    parameters: &[&(dyn ToSql + Sync)],
) -> Result<Row, Failure> {
    let statement = client.prepare_cached(sql).await?;
    Ok(client.query_one(&statement, parameters).await?)
}

/// Changes rows, and counts them.
pub(super) async fn execute(
    client: &impl GenericClient,
    sql: &str,
    parameters: &[&(dyn ToSql + Sync)],
) -> Result<u64, Failure> {
    let statement = client.prepare_cached(sql).await?;
    Ok(client.execute(&statement, parameters).await?)
}
