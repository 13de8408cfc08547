//! Connections to the file: the one that writes, and those that read; and how statements are run on them.
//!
//! A prepared statement takes some microseconds, less than the way to another thread and back. So the writer's thread
//! runs changes, and a task reads a few rows itself; long reads run on a thread for blocking work. Knows no table.

use std::fs::{File, TryLockError};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use rusqlite::config::DbConfig;
use rusqlite::{Connection, ErrorCode, OpenFlags, Params, Row, ffi};
use tokio::runtime::{Handle, RuntimeFlavor};
use tokio::sync::{Semaphore, SemaphorePermit};
use tokio::task::block_in_place;

use super::check::{self, Damage, is_damage};
use crate::error::{Error, Kind, Result};
use crate::service::blocking::blocking;
use crate::service::private;

/// Connections that read.
const READERS: u32 = 4;

/// Memory that a connection that reads keeps of the file, in KiB: four of them fill it in the first thousands of jobs,
/// and what they read is in the system's memory anyway.
const READ_CACHE: i32 = 512;

/// Size to which the write-ahead log is cut back after it grew larger.
const LOG_BYTES: u32 = 64 << 20;

/// For how long a connection waits for another one's lock.
const PATIENCE: Duration = Duration::from_secs(5);

/// Statements that a connection keeps prepared: more than there are.
const STATEMENTS: usize = 64;

/// Why something was not done.
#[derive(Debug)]
pub(super) enum Abort {
    /// It is not allowed; nothing was written.
    Refused(Error),
    /// The database failed, and the transaction with it.
    Broken(Error),
}

impl From<Error> for Abort {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

impl From<rusqlite::Error> for Abort {
    fn from(error: rusqlite::Error) -> Self {
        Self::Broken(error.into())
    }
}

impl From<Abort> for Error {
    fn from(abort: Abort) -> Self {
        match abort {
            Abort::Refused(error) | Abort::Broken(error) => error,
        }
    }
}

impl From<rusqlite::Error> for Error {
    /// Whether there is no room, or the file cannot be reached, or something is broken.
    fn from(error: rusqlite::Error) -> Self {
        use ErrorCode::*;
        if is_damage(&error) {
            return check::damaged(&message(&error));
        }
        let kind = match error.sqlite_error_code() {
            _ if lacks_room(&error) => Kind::InsufficientStorage,
            Some(
                PermissionDenied | DatabaseBusy | DatabaseLocked | OutOfMemory | ReadOnly | SystemIoFailure
                | CannotOpen,
            ) => Kind::Unavailable,
            _ => Kind::Internal,
        };
        Self::new(kind, format_args!("the store of jobs failed: {}", message(&error)))
    }
}

/// The message of the database, without the SQL.
pub(super) fn message(error: &rusqlite::Error) -> String {
    match error {
        rusqlite::Error::SqlInputError { msg, .. } => msg.clone(),
        _ => error.to_string(),
    }
}

/// The error of a store that was closed.
pub(super) fn closed() -> Error {
    Error::new(Kind::Unavailable, "the store of jobs is closed")
}

/// Whether the database failed for want of room on the disk.
pub(super) fn lacks_room(error: &rusqlite::Error) -> bool {
    const INDEX_OF_LOG: [i32; 3] = [ffi::SQLITE_IOERR_SHMSIZE, ffi::SQLITE_IOERR_SHMOPEN, ffi::SQLITE_IOERR_SHMMAP];
    error.sqlite_error_code() == Some(ErrorCode::DiskFull)
        || error.sqlite_error().is_some_and(|error| INDEX_OF_LOG.contains(&error.extended_code))
}

/// The file, and how connections to it are opened.
///
/// The index of the log is a file of 32 KiB, shared by processes, that SQLite writes when the first connection is
/// opened: on a full disk nothing could be read. While the file is *private*, the index is in the memory of this
/// process, and other processes (`tesserae backup`) find the file locked.
///
/// The service locks the whole file for itself, by a lock that SQLite does not know: another service is refused
/// whatever happened to the lock of the data folder.
#[derive(Debug)]
pub(super) struct Place {
    pub path: PathBuf,
    /// Whether the process outlasts the file: then no commit waits for the disk.
    pub is_temporary: bool,
    is_private: AtomicBool,
    /// Closed after all connections: closing a file that SQLite has locked ends SQLite's own locks (POSIX).
    lock: Option<File>,
}

impl Place {
    /// SQLite's way to open a file for one process.
    const PRIVATE: &str = "unix-excl";

    /// The file at `path`, shared.
    #[cfg(test)]
    pub fn shared(path: PathBuf) -> Self {
        Self { path, is_temporary: false, is_private: AtomicBool::new(false), lock: None }
    }

    /// The file at `path`, shared, and locked for this service. [`Kind::Conflict`] when another one has it.
    pub fn locked(path: PathBuf) -> Result<Self> {
        let cannot = |error| Error::io(format_args!("the store of jobs cannot be opened: {}", path.display()), error);
        let lock = private::options().open(&path).map_err(cannot)?;
        // elsewhere, a lock would keep SQLite from reading
        if cfg!(unix) {
            match lock.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::new(
                        Kind::Conflict,
                        format_args!(
                            "another process works with the store of jobs; stop it, or give this one another \
                             --data-dir: {}",
                            path.display()
                        ),
                    ));
                }
                Err(TryLockError::Error(error)) => return Err(cannot(error)),
            }
        }
        Ok(Self { path, is_temporary: false, is_private: AtomicBool::new(false), lock: Some(lock) })
    }

    /// Lets another process work with the file, once all connections are closed.
    pub fn release(&self) {
        if let Some(Err(error)) = self.lock.as_ref().map(File::unlock) {
            tracing::warn!(%error, "the store of jobs stays locked until the process ends");
        }
    }

    /// The same in a temporary folder, which no other process knows.
    pub fn temporary(path: PathBuf) -> Self {
        Self { path, is_temporary: true, is_private: AtomicBool::new(false), lock: None }
    }

    /// Whether the file is private.
    pub fn is_private(&self) -> bool {
        self.is_private.load(Ordering::Relaxed)
    }

    /// Makes the file private, or shared again, for connections that are opened from now on.
    pub fn set_private(&self, is_private: bool) {
        self.is_private.store(is_private && cfg!(unix), Ordering::Relaxed);
    }

    /// Opens the connection that writes, and makes the file if that may be.
    pub fn writing(&self, may_create: bool) -> rusqlite::Result<Connection> {
        if may_create {
            // SQLite gives the log the mode of this file
            private::options().open(&self.path).map_err(|_| rusqlite::Error::InvalidPath(self.path.clone()))?;
        }
        let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE;
        flags.set(OpenFlags::SQLITE_OPEN_CREATE, may_create);
        let connection = self.open(flags)?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        connection.pragma_update(None, "synchronous", if self.is_temporary { "OFF" } else { "FULL" })?;
        connection.pragma_update(None, "journal_size_limit", LOG_BYTES)?;
        Ok(connection)
    }

    /// Opens a connection that reads.
    fn reading(&self) -> rusqlite::Result<Connection> {
        let connection = match self.is_private() {
            // a file that is opened for reading only would not be locked by this process
            true => self.open(OpenFlags::SQLITE_OPEN_READ_WRITE)?,
            false => self.open(OpenFlags::SQLITE_OPEN_READ_ONLY)?,
        };
        connection.pragma_update(None, "query_only", true)?;
        connection.pragma_update(None, "cache_size", -READ_CACHE)?;
        Ok(connection)
    }

    fn open(&self, flags: OpenFlags) -> rusqlite::Result<Connection> {
        let flags = flags | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = match self.is_private() {
            true => Connection::open_with_flags_and_vfs(&self.path, flags, Self::PRIVATE)?,
            false => Connection::open_with_flags(&self.path, flags)?,
        };
        prepare(connection)
    }
}

fn prepare(connection: Connection) -> rusqlite::Result<Connection> {
    connection.busy_timeout(PATIENCE)?;
    connection.set_prepared_statement_cache_capacity(STATEMENTS);
    // Plans do not depend on what is bound; without this, some statements are prepared anew whenever something else is.
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_QPSG, true)?;
    Ok(connection)
}

/// Connections that read.
#[derive(Debug)]
pub(super) struct Readers {
    place: Arc<Place>,
    /// One for each connection that may be.
    places: Arc<Semaphore>,
    /// What they find broken in the file.
    pub damage: Arc<Damage>,
    idle: Mutex<Vec<Connection>>,
}

impl Readers {
    /// For a file that is there.
    pub fn open(place: Arc<Place>) -> rusqlite::Result<Self> {
        let places = Arc::new(Semaphore::new(READERS as usize));
        let readers = Self { place, places, damage: Arc::default(), idle: Mutex::default() };
        readers.give_back(readers.place.reading()?);
        Ok(readers)
    }

    /// Reads a few rows that an index finds, on this thread. Where it waits for a lock or a disk, the other tasks of
    /// this thread continue on another one.
    pub async fn read<T>(&self, work: impl FnOnce(&Connection) -> Result<T, Abort>) -> Result<T> {
        let _place = self.places.acquire().await.map_err(|_| closed())?;
        match Handle::current().runtime_flavor() {
            RuntimeFlavor::CurrentThread => self.work(work),
            _ => block_in_place(|| self.work(work)),
        }
    }

    /// Reads what may be many rows, on a thread for blocking work.
    pub async fn read_much<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&Connection) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let place = Arc::clone(&self.places).acquire_owned().await.map_err(|_| closed())?;
        let this = Arc::clone(self);
        blocking(move || {
            // kept to the end, also when the caller has given up
            let _place = place;
            this.work(work)
        })
        .await?
    }

    /// Waits for reads under way, and closes the connections. Others are opened once what this returns is dropped.
    pub async fn pause(&self) -> Option<SemaphorePermit<'_>> {
        let all = self.places.acquire_many(READERS).await.ok();
        self.idle.lock().clear();
        all
    }

    /// Waits for reads under way, and closes the connections.
    pub async fn close(&self) {
        let _all = self.pause().await;
        self.places.close();
    }

    fn work<T>(&self, work: impl FnOnce(&Connection) -> Result<T, Abort>) -> Result<T> {
        let idle = self.idle.lock().pop();
        let connection = match idle {
            Some(connection) => connection,
            None => self.place.reading()?,
        };
        let outcome = work(&connection);
        match outcome {
            // one that failed is not used again
            Err(Abort::Broken(error)) => Err(self.damage.note(error)),
            Ok(_) | Err(Abort::Refused(_)) => {
                self.give_back(connection);
                Ok(outcome?)
            }
        }
    }

    fn give_back(&self, connection: Connection) {
        self.idle.lock().push(connection);
    }
}

/// Runs a statement; the number of rows that it changed.
pub(super) fn execute(connection: &Connection, sql: &str, parameters: impl Params) -> Result<usize, Abort> {
    Ok(connection.prepare_cached(sql)?.execute(parameters)?)
}

/// What `read` makes of the rows of a query.
pub(super) fn all<T>(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
    mut read: impl FnMut(&Row<'_>) -> Result<T>,
) -> Result<Vec<T>, Abort> {
    let mut statement = connection.prepare_cached(sql)?;
    let mut rows = statement.query(parameters)?;
    let mut found = Vec::new();
    while let Some(row) = rows.next()? {
        found.push(read(row)?);
    }
    Ok(found)
}

/// What `read` makes of the first row of a query, if there is one.
pub(super) fn first<T>(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
    read: impl FnOnce(&Row<'_>) -> Result<T>,
) -> Result<Option<T>, Abort> {
    let mut statement = connection.prepare_cached(sql)?;
    let mut rows = statement.query(parameters)?;
    Ok(rows.next()?.map(read).transpose()?)
}

/// What `read` makes of the row of a query that always has one.
pub(super) fn one<T>(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
    read: impl FnOnce(&Row<'_>) -> Result<T>,
) -> Result<T, Abort> {
    first(connection, sql, parameters, read)?.ok_or_else(|| rusqlite::Error::QueryReturnedNoRows.into())
}
