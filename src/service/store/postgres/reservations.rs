//! Reservations of uploads by URL.

use std::time::Duration;

use async_trait::async_trait;
use tokio_postgres::types::Json;

use super::super::{JobId, Reservation, Reservations};
use super::connections::{execute, first, one};
use super::replica::PostgresStore;
use super::rows::{column, count, json};
use crate::error::Result;

const RESERVE: &str = "WITH over AS (\
    DELETE FROM reservations WHERE id IN (SELECT id FROM reservations \
        WHERE expires_at <= clock_timestamp() - make_interval(secs => $4) FOR UPDATE SKIP LOCKED)\
) INSERT INTO reservations (id, tenant, upload, expires_at) \
VALUES ($1, $2, $3, clock_timestamp() + make_interval(secs => $4))";

#[async_trait]
impl Reservations for PostgresStore {
    async fn reserve(&self, id: JobId, reservation: Reservation, valid: Duration) -> Result<()> {
        let reservation = &reservation;
        let reserved = self.connections.run(|client| async move {
            let parameters =
                [&id.uuid() as _, &reservation.tenant as _, &Json(reservation) as _, &valid.as_secs_f64() as _];
            execute(&client, RESERVE, &parameters).await
        });
        reserved.await.map(drop)
    }

    async fn reservation(&self, id: JobId) -> Result<Option<Reservation>> {
        let found = self.connections.run(|client| async move {
            let sql = "SELECT upload, expires_at <= clock_timestamp() AS is_over FROM reservations WHERE id = $1";
            let row = first(&client, sql, &[&id.uuid()]).await?;
            let reservation = |row| {
                let is_over = column(row, "is_over")?;
                Ok::<_, crate::Error>(Reservation { is_over, ..json(row, "upload")? })
            };
            Ok(row.as_ref().map(reservation).transpose()?)
        });
        found.await
    }

    async fn unreserve(&self, id: JobId) -> Result<bool> {
        let removed = self.connections.run(|client| async move {
            execute(&client, "DELETE FROM reservations WHERE id = $1", &[&id.uuid()]).await
        });
        Ok(removed.await? > 0)
    }

    async fn waiting_of(&self, tenant: &str) -> Result<u64> {
        let found = self.connections.run(|client| async move {
            let sql = "SELECT (SELECT count(*) FROM jobs WHERE state = 'queued' AND tenant = $1) + (SELECT count(*) \
                       FROM reservations WHERE tenant = $1 AND expires_at > clock_timestamp()) AS waiting";
            Ok(count(&one(&client, sql, &[&tenant]).await?, "waiting")?)
        });
        found.await
    }
}
