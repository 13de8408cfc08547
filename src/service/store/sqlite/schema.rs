//! The tables, and how they came to be: each migration is run once, in order, and never changed after a release.
//!
//! The version of the tables is the number of migrations that were run. It stands in the head of the file (`PRAGMA
//! user_version`) and is written by the transaction that changes the tables. Earlier it was kept as rows of a table,
//! `_sqlx_migrations`; a file that has it is taken over, and the table goes: what is not kept up must not be believed.

use rusqlite::{Connection, TransactionBehavior};

use super::connections::message;

/// Every migration's SQL.
const MIGRATIONS: [&str; 5] = [
    include_str!("migrations/0001_jobs.sql"),
    include_str!("migrations/0002_blobs.sql"),
    include_str!("migrations/0003_notices.sql"),
    include_str!("migrations/0004_fairness.sql"),
    include_str!("migrations/0005_nth_end.sql"),
];

/// Value of `PRAGMA auto_vacuum` with which free pages are given back on demand.
const INCREMENTAL: i64 = 2;

/// Bytes in use of a file that is rewritten when it is opened, at most.
const MOST_REWRITTEN: i64 = 16 << 20;

/// Why the tables cannot be brought up to date.
#[derive(Debug, thiserror::Error)]
pub(super) enum MigrateError {
    /// The database failed.
    #[error("{}", message(.0))]
    Database(#[from] rusqlite::Error),
    /// There is no source of random bytes.
    #[error("{0}")]
    Random(crate::error::Error),
    /// They were made by a later version of the service.
    #[error(
        "its tables are of version {found}, and this version of tesserae knows them up to {known}: start the version \
         that wrote them, or a later one"
    )]
    TooNew { found: i64, known: u32 },
}

/// Brings the tables up to date. Fails on those of a later version of the service, and changes nothing then.
pub(super) fn migrate(connection: &mut Connection) -> Result<(), MigrateError> {
    migrate_to(MIGRATIONS.len() as u32, connection)
}

/// Brings the tables up to a version.
pub(super) fn migrate_to(known: u32, connection: &mut Connection) -> Result<(), MigrateError> {
    let by_rows = version_by_rows(connection)?;
    let found = match version(connection)? {
        0 => by_rows.unwrap_or(0),
        // an earlier build that was tried on this file left an empty table behind
        version => version,
    };
    // what is no number of migrations was not written by this service
    let Some(current) = u32::try_from(found).ok().filter(|&found| found <= known) else {
        return Err(MigrateError::TooNew { found, known });
    };
    if by_rows.is_some() {
        advance(connection, current, "DROP TABLE _sqlx_migrations")?;
    }
    for (version, sql) in (1..=known).zip(MIGRATIONS).skip(current as usize) {
        advance(connection, version, sql)?;
    }
    Ok(())
}

/// Lets the file give pages of deleted jobs back to the file system. This writes the whole file anew, so one that holds
/// more than [`MOST_REWRITTEN`] stays as it is until it holds less.
pub(super) fn let_shrink(connection: &Connection) -> rusqlite::Result<()> {
    let number = |name| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    let bytes = (number("page_count")? - number("freelist_count")?) * number("page_size")?;
    if number("auto_vacuum")? == INCREMENTAL || bytes > MOST_REWRITTEN {
        return Ok(());
    }
    // in memory: there may be no folder for temporary files
    connection.execute_batch("PRAGMA temp_store = MEMORY; PRAGMA auto_vacuum = INCREMENTAL; VACUUM")?;
    connection.execute_batch("PRAGMA temp_store = DEFAULT")
}

/// Changes the tables to those of a version.
fn advance(connection: &mut Connection, version: u32, sql: &str) -> rusqlite::Result<()> {
    let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    transaction.execute_batch(sql)?;
    transaction.pragma_update(None, "user_version", version)?;
    transaction.commit()
}

fn version(connection: &Connection) -> rusqlite::Result<i64> {
    connection.pragma_query_value(None, "user_version", |row| row.get(0))
}

/// The version as it was kept earlier; none where it is not.
fn version_by_rows(connection: &Connection) -> rusqlite::Result<Option<i64>> {
    match connection.table_exists(None, "_sqlx_migrations")? {
        true => connection.query_row("SELECT coalesce(max(version), 0) FROM _sqlx_migrations", [], |row| row.get(0)),
        false => Ok(None),
    }
}
