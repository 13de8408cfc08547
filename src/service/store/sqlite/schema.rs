//! The tables, and how they came to be: each migration is run once, in order, and never changed after a release.

use sqlx::migrate::{MigrateError, Migration, MigrationType, Migrator};
use sqlx::{SqlSafeStr as _, SqliteConnection};

/// Every migration: what it does, and its SQL.
const MIGRATIONS: [(&str, &str); 3] = [
    ("jobs and events", include_str!("migrations/0001_jobs.sql")),
    ("small blobs", include_str!("migrations/0002_blobs.sql")),
    ("ends to be told", include_str!("migrations/0003_notices.sql")),
];

/// Brings the tables up to date. Fails on those of a later version of the service, and changes nothing then.
pub(super) async fn migrate(connection: SqliteConnection) -> Result<SqliteConnection, MigrateError> {
    migrate_to(MIGRATIONS.len(), connection).await
}

/// Brings the tables up to a version.
pub(super) async fn migrate_to(
    version: usize,
    mut connection: SqliteConnection,
) -> Result<SqliteConnection, MigrateError> {
    let migrations = (1..).zip(MIGRATIONS).take(version).map(|(version, (description, sql))| {
        Migration::new(version, description.into(), MigrationType::Simple, sql.into_sql_str(), false)
    });
    Migrator::with_migrations(migrations.collect()).run_direct(None, &mut connection, false).await?;
    Ok(connection)
}
