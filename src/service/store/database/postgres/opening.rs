//! Opening the database: with the tables as they are to be.

use tesserae_mesh::error::{Error, Kind, Result};
use tokio::time::Instant;
use tokio_postgres::Client;

use super::super::{Abort, steps};
use super::connections::{Connections, PATIENCE, failure};
use crate::ops::blocking;

/// What the tables need beside what SQLite knows: room for changes beside their rows, and bytes without compression,
/// which for meshes and labels costs more time than it saves.
const STORAGE: &str = "\
    ALTER TABLE jobs SET (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.02, autovacuum_vacuum_threshold = 500); \
    ALTER TABLE workers SET (fillfactor = 50); ALTER TABLE tenants SET (fillfactor = 50); \
    ALTER TABLE blobs ALTER COLUMN bytes SET STORAGE EXTERNAL";

pub async fn open(connections: Connections, migrations: &'static [&'static str]) -> Result<()> {
    let deadline = Instant::now() + PATIENCE;
    let migrated = blocking(move || {
        let mut connection = connections.get(deadline)?;
        connection
            .wait(deadline, async |client, _| migrate(client, migrations).await)
            .ok_or_else(|| connections.too_late())?
    });
    migrated.await?.map_err(Abort::into_error)
}

/// One service migrates at a time, under an advisory lock.
async fn migrate(client: &mut Client, migrations: &[&str]) -> Result<(), Abort> {
    let transaction = client.transaction().await.map_err(failure)?;
    let run = async |sql: &str| transaction.batch_execute(sql).await.map_err(failure);
    let number = async |sql: &str| {
        let row = transaction.query_one(sql, &[]).await;
        row.and_then(|row| row.try_get::<_, i64>(0)).map_err(failure)
    };
    let server = number("SELECT CAST(current_setting('server_version_num') AS bigint)").await?;
    if server < 150_000 {
        let message = format_args!("the store of jobs needs PostgreSQL 15 or later; the server is {server}");
        return Err(Error::new(Kind::Io, message).into());
    }
    run("SELECT pg_advisory_xact_lock(1953723250, 0)").await?;
    // an operator may make it for a user that may not
    if number("SELECT count(*) FROM pg_namespace WHERE nspname = 'tesserae'").await? == 0 {
        run("CREATE SCHEMA tesserae").await?;
    }
    run("CREATE TABLE IF NOT EXISTS schema_version (version bigint NOT NULL)").await?;
    let found = number("SELECT coalesce(max(version), 0) FROM schema_version").await?;
    let steps = steps(found, migrations)?;
    if steps.is_empty() {
        return transaction.rollback().await.map_err(failure);
    }
    for sql in steps {
        run(&for_postgres(sql)).await?;
    }
    if found == 0 {
        run(STORAGE).await?;
    }
    let version = migrations.len();
    run(&format!("DELETE FROM schema_version; INSERT INTO schema_version VALUES ({version})")).await?;
    transaction.commit().await.map_err(failure)
}

/// Statements in the dialect of PostgreSQL. SQLite takes a partial index for the first of its columns only; PostgreSQL
/// leaves a comparison out that the index implies, and would then read the whole index.
fn for_postgres(sql: &str) -> String {
    let names = [
        ("ON jobs (state, ", "ON jobs ("),
        ("INTEGER PRIMARY KEY AUTOINCREMENT", "BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY"),
        ("INTEGER", "BIGINT"),
        ("REAL", "DOUBLE PRECISION"),
        ("TEXT", "TEXT COLLATE \"C\""),
        ("BLOB", "BYTEA"),
        (" STRICT, WITHOUT ROWID;", ";"),
        (" STRICT;", ";"),
    ];
    names.iter().fold(sql.to_owned(), |sql, (from, to)| sql.replace(from, to))
}
