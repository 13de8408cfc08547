//! The tables, and how they came to be: each migration is run once, in order, and never changed after a release.

use sqlx::migrate::{MigrateError, Migration, MigrationType, Migrator};
use sqlx::{SqlSafeStr as _, SqliteConnection};

/// Every migration: what it does, and its SQL.
const MIGRATIONS: [(&str, &str); 2] = [
    ("jobs and events", include_str!("migrations/0001_jobs.sql")),
    ("small blobs", include_str!("migrations/0002_blobs.sql")),
];

/// Brings the tables up to date. Fails on those of a later version of the service, and changes nothing then.
pub(super) async fn migrate(mut connection: SqliteConnection) -> Result<SqliteConnection, MigrateError> {
    let migrations = (1..).zip(MIGRATIONS).map(|(version, (description, sql))| {
        Migration::new(version, description.into(), MigrationType::Simple, sql.into_sql_str(), false)
    });
    Migrator::with_migrations(migrations.collect()).run_direct(None, &mut connection, false).await?;
    Ok(connection)
}
