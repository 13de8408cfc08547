//! Opening the database: with the tables as they are to be.

use tesserae_mesh::error::{Error, Kind, Result};
use tokio::time::{Instant, timeout_at};
use tokio_postgres::Client;

use super::super::super::schema::{self, MIGRATIONS, for_postgres};
use super::super::Abort;
use super::connections::{Connections, PATIENCE, failure};

/// What the tables need beside what SQLite knows: room for changes beside their rows, and bytes without compression,
/// which for meshes and labels costs more time than it saves.
const STORAGE: &str = "\
    ALTER TABLE jobs SET (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.02, autovacuum_vacuum_threshold = 500); \
    ALTER TABLE workers SET (fillfactor = 50); ALTER TABLE tenants SET (fillfactor = 50); \
    ALTER TABLE blobs ALTER COLUMN bytes SET STORAGE EXTERNAL";

const VERSION: &str = "CREATE TABLE IF NOT EXISTS schema_version (version bigint NOT NULL)";

/// Oldest server that is worked with, as it tells its version.
const OLDEST_SERVER: i64 = 150_000;

pub async fn open(connections: &Connections) -> Result<()> {
    let deadline = Instant::now() + PATIENCE;
    let mut client = connections.get(deadline).await.map_err(Abort::into_error)?;
    match timeout_at(deadline, migrate(&mut client)).await {
        Ok(migrated) => migrated.map_err(Abort::into_error),
        Err(_) => Err(connections.too_late().into_error()),
    }
}

/// One service migrates at a time, under an advisory lock.
async fn migrate(client: &mut Client) -> Result<(), Abort> {
    let transaction = client.transaction().await.map_err(failure)?;
    let run = async |sql: &str| transaction.batch_execute(sql).await.map_err(failure);
    let number = async |sql: &str| {
        let row = transaction.query_one(sql, &[]).await;
        row.and_then(|row| row.try_get::<_, i64>(0)).map_err(failure)
    };
    let server = number("SELECT CAST(current_setting('server_version_num') AS bigint)").await?;
    if server < OLDEST_SERVER {
        let message = format_args!("the store of jobs needs PostgreSQL 15 or later; the server is {server}");
        return Err(Error::new(Kind::Io, message).into());
    }
    run("SELECT pg_advisory_xact_lock(1953723250, 0)").await?;
    // an operator may make it for a user that may not
    if number("SELECT count(*) FROM pg_namespace WHERE nspname = 'tesserae'").await? == 0 {
        run("CREATE SCHEMA tesserae").await?;
    }
    run(VERSION).await?;
    let found = number("SELECT coalesce(max(version), 0) FROM schema_version").await?;
    let steps = schema::steps(found, &MIGRATIONS)?;
    if steps.is_empty() {
        return Ok(());
    }
    for sql in steps {
        run(&for_postgres(sql)).await?;
    }
    if found == 0 {
        run(STORAGE).await?;
    }
    let version = MIGRATIONS.len();
    run(&format!("DELETE FROM schema_version; INSERT INTO schema_version VALUES ({version})")).await?;
    transaction.commit().await.map_err(failure)
}
