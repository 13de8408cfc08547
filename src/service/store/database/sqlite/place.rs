//! The file, how connections to it are opened, and how they fail.

use std::fs::{File, Metadata, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

use parking_lot::Mutex;
use rusqlite::config::DbConfig;
use rusqlite::{Connection, ErrorCode, OpenFlags, ffi};
use tesserae_mesh::error::{Error, Kind, Result};

use super::super::Abort;
use crate::ops::private;

const DAMAGED: &str = "the store of jobs is damaged";

impl From<rusqlite::Error> for Abort {
    fn from(error: rusqlite::Error) -> Self {
        Self::Broken(failure(error))
    }
}

/// Whether there is no room, or the file cannot be reached, or something is broken.
pub fn failure(error: rusqlite::Error) -> Error {
    use ErrorCode::*;
    if is_damage(&error) {
        let remedy = "stop the service and put a backup in the place of jobs.sqlite3";
        return Error::unavailable(format_args!("{DAMAGED}; {remedy}: {}", message(&error)));
    }
    let kind = match error.sqlite_error_code() {
        _ if lacks_room(&error) => Kind::InsufficientStorage,
        Some(
            PermissionDenied | DatabaseBusy | DatabaseLocked | OutOfMemory | ReadOnly | SystemIoFailure | CannotOpen,
        ) => Kind::Unavailable,
        _ => Kind::Internal,
    };
    Error::new(kind, format_args!("the store of jobs failed: {}", message(&error)))
}

pub fn is_damage(error: &rusqlite::Error) -> bool {
    matches!(error.sqlite_error_code(), Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase))
}

/// The message of the database, without the SQL.
pub fn message(error: &rusqlite::Error) -> String {
    match error {
        rusqlite::Error::SqlInputError { msg, .. } => msg.clone(),
        _ => error.to_string(),
    }
}

pub fn closed() -> Error {
    Error::unavailable("the store of jobs is closed")
}

pub fn lacks_room(error: &rusqlite::Error) -> bool {
    const INDEX_OF_LOG: [i32; 3] = [ffi::SQLITE_IOERR_SHMSIZE, ffi::SQLITE_IOERR_SHMOPEN, ffi::SQLITE_IOERR_SHMMAP];
    error.sqlite_error_code() == Some(ErrorCode::DiskFull)
        || error.sqlite_error().is_some_and(|error| INDEX_OF_LOG.contains(&error.extended_code))
}

/// The file. The service locks the whole of it for itself, by a lock that SQLite does not know: another service is
/// refused whatever happened to the lock of the data folder.
pub struct DatabasePlace {
    pub path: PathBuf,
    /// Whether the process outlasts the file: then no commit waits for the disk.
    pub is_temporary: bool,
    /// Closed after all connections: closing a file that SQLite has locked ends SQLite's own locks (POSIX).
    lock: File,
    damage: Mutex<Option<Error>>,
}

impl DatabasePlace {
    /// The file at `path`, which is made if need be. [`Kind::Conflict`] when another service has it.
    pub fn lock(path: PathBuf, is_temporary: bool) -> Result<Self> {
        let cannot = |error| Error::io(format_args!("the store of jobs cannot be opened: {}", path.display()), error);
        // SQLite gives the log the mode of this file
        let lock = private::options().open(&path).map_err(cannot)?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { path, is_temporary, lock, damage: Mutex::default() }),
            Err(TryLockError::WouldBlock) => Err(Error::conflict(format_args!(
                "another process works with the store of jobs; stop it, or give this one another --data-dir: {}",
                path.display()
            ))),
            Err(TryLockError::Error(error)) => Err(cannot(error)),
        }
    }

    /// Lets another process work with the file, once all connections are closed.
    pub fn release(&self) {
        if let Err(error) = self.lock.unlock() {
            tracing::warn!(%error, "the store of jobs stays locked until the process ends");
        }
    }

    /// Keeps and logs an error of damage, whose remedy is for the operator; the error for clients. SQLite finds damage
    /// only where it looks, so what one statement found stands until the service is started again.
    pub fn note(&self, error: Error) -> Error {
        if !error.message.starts_with(DAMAGED) {
            return error;
        }
        self.damage.lock().get_or_insert_with(|| {
            tracing::error!("{error}");
            error
        });
        Error::unavailable("the storage of the service is damaged; its operator must repair it")
    }

    /// An error where there is damage, or where the path names another file or none: jobs in a file without a name are
    /// gone with the process.
    pub fn check(&self) -> Result<()> {
        self.damage().map_or(Ok(()), Err)?;
        let number = |found: io::Result<Metadata>| found.map(|found| (found.dev(), found.ino()));
        match (number(self.lock.metadata()), number(self.path.metadata())) {
            (Ok(opened), Ok(named)) if opened == named => Ok(()),
            _ => Err(Error::unavailable(
                "jobs.sqlite3 was removed or replaced while the service works with it: what it accepts now is lost \
                 when it stops; stop it and put a backup in the place of jobs.sqlite3",
            )),
        }
    }

    pub fn damage(&self) -> Option<Error> {
        self.damage.lock().clone()
    }

    /// The connection that writes. It makes no file: one that is gone is not replaced by an empty one.
    pub fn writing(&self) -> rusqlite::Result<Connection> {
        let connection = self.open(OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        if connection.pragma_query_value(None, "page_count", |row| row.get::<_, i64>(0))? == 0 {
            // no job is in a new file yet, and the next statement writes its page again, to the disk
            connection.pragma_update(None, "synchronous", "OFF")?;
            // pages of deleted jobs can be given back to the file system
            connection.pragma_update(None, "auto_vacuum", "INCREMENTAL")?;
        }
        connection.pragma_update(None, "synchronous", if self.is_temporary { "OFF" } else { "FULL" })?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        // bytes to which the log is cut back after it grew larger
        connection.pragma_update(None, "journal_size_limit", 64 << 20)?;
        Ok(connection)
    }

    pub fn reading(&self) -> rusqlite::Result<Connection> {
        let connection = self.open(OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        connection.pragma_update(None, "query_only", true)?;
        // 512 KiB: four connections fill it in the first thousands of jobs, and the system keeps what they read anyway
        connection.pragma_update(None, "cache_size", -512)?;
        Ok(connection)
    }

    fn open(&self, flags: OpenFlags) -> rusqlite::Result<Connection> {
        let connection = Connection::open_with_flags(&self.path, flags | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
        // more statements than there are
        connection.set_prepared_statement_cache_capacity(64);
        // plans do not depend on what is bound: no statement is prepared anew because something else is
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_QPSG, true)?;
        Ok(connection)
    }
}
