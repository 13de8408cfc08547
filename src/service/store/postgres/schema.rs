//! The tables, and how they came to be: each migration is run once, in order, and never changed after a release.
//!
//! One service migrates at a time, under an advisory lock. Services of the release before go on working meanwhile: a
//! migration adds first, and what is not used any more goes one release later. Each migration therefore says which
//! version of this list a service must know at least to work on the tables; a service that knows less is refused.

use tokio_postgres::Client;

use super::connections::Failure;
use crate::error::{Error, Kind};

/// Every migration's SQL, and the least number of migrations that a service on the tables must know afterwards.
const MIGRATIONS: [(&str, i32); 2] =
    [(include_str!("migrations/0001_farm.sql"), 1), (include_str!("migrations/0002_workers.sql"), 1)];

/// The table with the version.
const VERSION: &str = "CREATE TABLE IF NOT EXISTS schema_version (version integer NOT NULL, needs integer NOT NULL)";

/// Oldest server that is worked with, as it tells its version.
const OLDEST_SERVER: i32 = 150_000;

/// Brings the tables up to date. [`Kind::Io`] for tables of a later release, which stay as they are.
pub(super) async fn migrate(client: &mut Client) -> Result<(), Failure> {
    let server: String = client.query_one("SHOW server_version_num", &[]).await?.try_get(0)?;
    if server.parse::<i32>().is_ok_and(|version| version < OLDEST_SERVER) {
        let message = format_args!("the store of jobs needs PostgreSQL 15 or later; the server is {server}");
        return Err(Error::new(Kind::Io, message).into());
    }
    let known = MIGRATIONS.len() as i32;
    let transaction = client.transaction().await?;
    transaction.execute("SELECT pg_advisory_xact_lock(1953723250, 0)", &[]).await?;
    // an operator may make it for a user that may not
    let sql = "SELECT to_regnamespace('tesserae') IS NULL";
    if transaction.query_one(sql, &[]).await?.try_get(0)? {
        transaction.batch_execute("CREATE SCHEMA tesserae").await?;
    }
    transaction.batch_execute(VERSION).await?;
    let row = transaction.query_opt("SELECT version, needs FROM schema_version", &[]).await?;
    let (found, needs) = match row {
        Some(row) => (row.try_get(0)?, row.try_get(1)?),
        None => (0, 0),
    };
    if needs > known {
        return Err(too_new(found, known).into());
    }
    for (version, (sql, needs)) in (1..=known).zip(MIGRATIONS).skip(usize::try_from(found).unwrap_or(usize::MAX)) {
        transaction.batch_execute(sql).await?;
        transaction.execute("DELETE FROM schema_version", &[]).await?;
        transaction.execute("INSERT INTO schema_version VALUES ($1, $2)", &[&version, &needs]).await?;
    }
    transaction.commit().await?;
    Ok(())
}

/// The error of tables that a later release made.
fn too_new(found: i32, known: i32) -> Error {
    Error::new(
        Kind::Io,
        format_args!(
            "the tables of the store of jobs are of version {found}, and this version of tesserae knows them up to \
             {known}: start the version that wrote them, or a later one"
        ),
    )
}
