//! Notices of ends: each is delivered by one service, which has it for a while and goes on having it while it lives.

use std::time::SystemTime;

use async_trait::async_trait;
use tokio::sync::watch;

use super::super::{JobId, Notice, Notices};
use super::connections::{all, execute, first};
use super::replica::PostgresStore;
use super::rows;
use crate::error::Result;

/// Takes up to 256 notices that no living service delivers, and gives all that this one has.
const TAKE: &str = "WITH free AS (\
    SELECT place FROM notices \
    WHERE teller IS DISTINCT FROM $1 AND (teller IS NULL OR lease_until <= clock_timestamp()) \
    ORDER BY place LIMIT 256 FOR UPDATE SKIP LOCKED\
), kept AS (\
    UPDATE notices SET lease_until = clock_timestamp() + interval '90 s' \
    WHERE teller = $1 AND lease_until < clock_timestamp() + interval '45 s' AND place NOT IN (SELECT place FROM free)\
), taken AS (\
    UPDATE notices SET teller = $1, lease_until = clock_timestamp() + interval '90 s' FROM free \
    WHERE notices.place = free.place RETURNING notices.job, notices.place\
) SELECT job FROM (SELECT job, place FROM notices WHERE teller = $1 UNION SELECT job, place FROM taken) AS mine \
ORDER BY place";

#[async_trait]
impl Notices for PostgresStore {
    fn endings(&self) -> watch::Receiver<u64> {
        self.hints.endings.subscribe()
    }

    /// Those that this service delivers.
    async fn untold(&self) -> Result<Vec<JobId>> {
        let taken = self.connections.run(|client| async move {
            let rows = all(&client, TAKE, &[&self.me]).await?;
            Ok(rows.iter().map(|row| rows::id(row, "job")).collect::<Result<Vec<_>>>()?)
        });
        taken.await
    }

    async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        let found = self.connections.run(|client| async move {
            let row = first(&client, "SELECT * FROM notices WHERE job = $1", &[&id.uuid()]).await?;
            Ok(row.as_ref().map(rows::notice).transpose()?)
        });
        found.await
    }

    async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()> {
        let settled = self.connections.run(|client| async move {
            let sql = "DELETE FROM notices WHERE job = $1 AND ended_at = $2";
            execute(&client, sql, &[&id.uuid(), &ended_at]).await
        });
        settled.await.map(drop)
    }
}
