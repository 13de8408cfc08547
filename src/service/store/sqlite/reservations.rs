//! Reservations of uploads by URL.

use std::time::Duration;

use async_trait::async_trait;
use rusqlite::{Connection, params};

use super::super::{JobId, Reservation, Reservations};
use super::SqliteStore;
use super::connections::{execute, first, one};
use super::rows::{self, column, count, from_json, json, micros, text};
use crate::error::Result;

#[async_trait]
impl Reservations for SqliteStore {
    async fn reserve(&self, id: JobId, reservation: Reservation, valid: Duration) -> Result<()> {
        let reserve = move |batch: &mut super::Batch<'_>| {
            let (now, tenant) = (rows::now(), &reservation.tenant);
            execute(batch.connection, "DELETE FROM reservations WHERE expires_at <= ?1", [micros(now - valid)])?;
            let sql = "INSERT INTO reservations (id, tenant, upload, expires_at) VALUES (?1, ?2, ?3, ?4)";
            let row = params![id.to_string(), tenant, json(&reservation)?, micros(now + valid)];
            execute(batch.connection, sql, row).map(drop)
        };
        self.writer.carry_out(reserve).await
    }

    async fn reservation(&self, id: JobId) -> Result<Option<Reservation>> {
        let sql = "SELECT upload, expires_at FROM reservations WHERE id = ?1";
        let reservation = |row: &rusqlite::Row<'_>| {
            let is_over = rows::time(column(row, "expires_at")?) <= rows::now();
            Ok(Reservation { is_over, ..from_json("upload", text(row, "upload")?)? })
        };
        self.readers.read(|reader: &Connection| first(reader, sql, [id.to_string()], reservation)).await
    }

    async fn unreserve(&self, id: JobId) -> Result<bool> {
        let sql = "DELETE FROM reservations WHERE id = ?1";
        self.writer.carry_out(move |batch| Ok(execute(batch.connection, sql, [id.to_string()])? > 0)).await
    }

    async fn waiting_of(&self, tenant: &str) -> Result<u64> {
        let sql = "SELECT coalesce((SELECT queued FROM tenants WHERE name = ?1), 0) + (SELECT count(*) \
                   FROM reservations WHERE tenant = ?1 AND expires_at > ?2) AS waiting";
        let parameters = (tenant, micros(rows::now()));
        self.readers.read(|reader| one(reader, sql, parameters, |row| count(row, "waiting"))).await
    }
}
