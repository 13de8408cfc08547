//! Workers as rows.

use async_trait::async_trait;
use tokio_postgres::Row;
use uuid::Uuid;

use super::super::{JobId, Presence, Worker, WorkerId, Workers};
use super::connections::{all, execute};
use super::replica::PostgresStore;
use super::rows::column;
use crate::error::Result;

/// The workers of the last five minutes, and those with jobs.
const WORKERS: &str = "SELECT workers.*, running.jobs FROM workers CROSS JOIN LATERAL (\
    SELECT array(SELECT jobs.id FROM jobs WHERE boot = workers.id AND state = 'running' ORDER BY number) AS jobs\
) AS running WHERE seen_at > clock_timestamp() - interval '5 min' OR cardinality(running.jobs) > 0 \
ORDER BY started_at, id";

/// A worker that was killed leaves its row.
const FORGET: &str = "DELETE FROM workers WHERE seen_at < clock_timestamp() - interval '1 h' \
    AND NOT EXISTS (SELECT FROM jobs WHERE boot = workers.id AND state = 'running')";

fn worker(row: &Row) -> Result<Worker> {
    Ok(Worker {
        id: WorkerId(column(row, "id")?),
        name: column(row, "name")?,
        version: column(row, "version")?,
        device: column(row, "device")?,
        started_at: column(row, "started_at")?,
        seen_at: column(row, "seen_at")?,
        jobs: column::<Vec<Uuid>>(row, "jobs")?.into_iter().map(JobId::from_uuid).collect(),
    })
}

#[async_trait]
impl Workers for PostgresStore {
    /// Leaves `alive_until` as it is: it belongs to leases.
    async fn announce(&self, presence: &Presence) -> Result<()> {
        let announced = self.connections.run(|client| async move {
            let sql = "INSERT INTO workers (id, name, version, device) VALUES ($1, $2, $3, $4) \
                       ON CONFLICT (id) DO UPDATE SET name = excluded.name, device = excluded.device, \
                           seen_at = clock_timestamp()";
            execute(&client, sql, &[&self.me, &&*presence.name, &presence.version, &&*presence.device]).await?;
            execute(&client, FORGET, &[]).await
        });
        announced.await.map(drop)
    }

    async fn workers(&self) -> Result<Vec<Worker>> {
        let found = self.connections.run(|client| async move {
            let rows = all(&client, WORKERS, &[]).await?;
            Ok(rows.iter().map(worker).collect::<Result<Vec<_>>>()?)
        });
        found.await
    }
}
