//! Deletions, and the care of the store.

use std::sync::atomic::Ordering;
use std::time::SystemTime;

use async_trait::async_trait;

use super::super::{Deletion, JobId, Maintenance, Statistics};
use super::connections::{all, execute, first, one};
use super::replica::PostgresStore;
use super::rows::{self, column};
use crate::error::Result;

#[async_trait]
impl Maintenance for PostgresStore {
    fn is_durable(&self) -> bool {
        true
    }

    fn is_shared(&self) -> bool {
        true
    }

    async fn may_clean_up(&self) -> Result<bool> {
        let held = self.connections.run(|client| async move {
            let sql = "INSERT INTO duties AS duty (name, holder, until) \
                       VALUES ('clean-up', $1, clock_timestamp() + interval '90 s') \
                       ON CONFLICT (name) DO UPDATE SET holder = excluded.holder, until = excluded.until \
                       WHERE duty.holder = excluded.holder OR duty.until <= clock_timestamp()";
            execute(&client, sql, &[&self.me]).await
        });
        Ok(held.await? > 0)
    }

    async fn free_bytes(&self) -> Result<u64> {
        Ok(0)
    }

    async fn give_back(&self) -> Result<()> {
        Ok(())
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        let deleted = self.connections.run(|client| async move {
            let sql = "WITH job AS (\
                DELETE FROM jobs WHERE id = $1 AND state NOT IN ('queued', 'running') RETURNING number\
            ), without_events AS (\
                DELETE FROM events USING job WHERE events.job = job.number\
            ), without_blobs AS (\
                DELETE FROM blobs USING job WHERE blobs.job = job.number\
            ) SELECT EXISTS (SELECT FROM job) AS is_gone, EXISTS (SELECT FROM jobs WHERE id = $1) AS was_there";
            let row = one(&client, sql, &[&id.uuid()]).await?;
            Ok(match (column(&row, "is_gone")?, column(&row, "was_there")?) {
                (true, _) => Deletion::Deleted,
                (false, true) => Deletion::Live,
                (false, false) => Deletion::Unknown,
            })
        });
        let deleted = deleted.await?;
        if deleted == Deletion::Deleted {
            self.hints.pulses.forget(id);
        }
        Ok(deleted)
    }

    /// By their age: the clock of this machine may be another than that of the database.
    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        let limit = i64::try_from(limit).unwrap_or(i64::MAX);
        let age = match SystemTime::now().duration_since(time) {
            Ok(age) => age.as_secs_f64(),
            Err(ahead) => -ahead.duration().as_secs_f64(),
        };
        let found = self.connections.run(|client| async move {
            let sql = "SELECT id FROM jobs WHERE ended_at < clock_timestamp() - make_interval(secs => $1) \
                       ORDER BY ended_at LIMIT $2";
            let rows = all(&client, sql, &[&age, &limit]).await?;
            Ok(rows.iter().map(|row| rows::id(row, "id")).collect::<Result<Vec<_>>>()?)
        });
        found.await
    }

    /// Writes nothing: services that only answer have no row of their own to write to.
    async fn probe(&self) -> Result<()> {
        let found = self
            .connections
            .run(|client| async move { first(&client, "SELECT pg_is_in_recovery() AS is_standby", &[]).await });
        match found.await? {
            Some(row) if column::<bool>(&row, "is_standby")? => Err(crate::Error::new(
                crate::Kind::Unavailable,
                "the database of the store of jobs takes no changes: it is a standby",
            )),
            _ => Ok(()),
        }
    }

    fn statistics(&self) -> Statistics {
        Statistics {
            attempts_failed: self.attempts_failed.load(Ordering::Relaxed),
            given_up: self.given_up.load(Ordering::Relaxed),
            ..self.connections.statistics()
        }
    }

    async fn close(&self) {
        let left = self.connections.run(|client| async move {
            execute(&client, "UPDATE notices SET teller = NULL WHERE teller = $1", &[&self.me]).await?;
            execute(&client, "DELETE FROM duties WHERE holder = $1", &[&self.me]).await?;
            let sql = "DELETE FROM workers WHERE id = $1 \
                       AND NOT EXISTS (SELECT FROM jobs WHERE boot = $1 AND state = 'running')";
            execute(&client, sql, &[&self.me]).await
        });
        if let Err(error) = left.await {
            tracing::debug!(%error, "other services take over when leases are over");
        }
        self.shut().await;
    }
}
