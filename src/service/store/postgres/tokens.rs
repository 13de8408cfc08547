//! Tenants and their tokens.

use async_trait::async_trait;
use deadpool_postgres::GenericClient;
use serde_json::Value;
use tokio_postgres::types::Json;

use super::super::url::StoreUrl;
use super::super::{TokenRows, TokenStore};
use super::address::Address;
use super::connections::{Connections, Failure, PATIENCE, all, cannot_reach, execute, one};
use super::replica::PostgresStore;
use super::rows::{column, count};
use super::schema;
use crate::error::{Error, Kind, Result};

async fn read(client: &impl GenericClient) -> Result<TokenRows, Failure> {
    let rows = all(client, "SELECT tenant, entry FROM access", &[]).await?;
    let entry = |row| Ok::<_, Failure>((column(row, "tenant")?, column::<Json<Value>>(row, "entry")?.0));
    rows.iter().map(entry).collect()
}

impl PostgresStore {
    /// Changes the rows, whole or not at all, one change after the other. Nothing changes where `change` fails.
    pub async fn change_tokens<T, E: From<Error>>(
        &self,
        change: impl FnOnce(&mut TokenRows) -> Result<T, E>,
    ) -> Result<T, E> {
        let failed = |failure: Failure| E::from(Error::from(failure));
        let changed = self.connections.once(async |mut client| {
            let transaction = client.transaction().await.map_err(|error| failed(error.into()))?;
            execute(&transaction, "UPDATE access_version SET version = version + 1", &[]).await.map_err(failed)?;
            let mut rows = read(&transaction).await.map_err(failed)?;
            let done = change(&mut rows)?;
            let (tenants, entries): (Vec<_>, Vec<_>) =
                rows.into_iter().map(|(name, entry)| (name, Json(entry))).unzip();
            let written = async {
                execute(&transaction, "DELETE FROM access WHERE NOT tenant = ANY ($1)", &[&tenants]).await?;
                let sql = "INSERT INTO access SELECT * FROM unnest($1::text[], $2::json[]) \
                           ON CONFLICT (tenant) DO UPDATE SET entry = excluded.entry";
                execute(&transaction, sql, &[&tenants, &entries]).await
            };
            written.await.map_err(failed)?;
            transaction.commit().await.map_err(|error| failed(error.into()))?;
            Ok(done)
        });
        changed.await.unwrap_or_else(|| Err(E::from(unsure())))
    }
}

/// The error of a change without an answer.
fn unsure() -> Error {
    Error::new(
        Kind::Unavailable,
        format_args!(
            "the database gave no answer within {} s, so the tokens may have changed or not; `tesserae token list` \
             shows them once it does",
            PATIENCE.as_secs()
        ),
    )
}

/// The rows of a database that is not opened as a store: nothing there changes.
pub(in crate::service) async fn read_only(url: &StoreUrl) -> Result<TokenRows> {
    let connections = Connections::new(&Address::parse(url)?, 1)?;
    let found = connections.run(|client| async move {
        schema::check_tokens(&client).await?;
        read(&client).await
    });
    let found = found.await.map_err(cannot_reach);
    connections.close();
    found
}

#[async_trait]
impl TokenStore for PostgresStore {
    async fn token_version(&self) -> Result<u64> {
        let sql = "SELECT version FROM access_version";
        let found = self.connections.run(|client| async move { Ok(count(&one(&client, sql, &[]).await?, "version")?) });
        found.await
    }

    async fn token_rows(&self) -> Result<TokenRows> {
        self.connections.run(|client| async move { read(&client).await }).await
    }
}
