//! The processes that work on jobs, what each says about itself, and what they do for all.

use std::collections::HashMap;
use std::time::{Duration, SystemTime};

use serde::Serialize;
use tesserae_mesh::error::Result;
use tokio::sync::watch;
use utoipa::ToSchema;
use uuid::Uuid;

use super::database::{read, values};
use super::job::JobId;
use super::listeners::marked;
use super::store::Store;
use super::terms::Notice;
use crate::ops::rfc3339;

/// A process that works on jobs.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(crate) struct Worker {
    /// Which one: new at every start of the process.
    #[schema(format = "uuid")]
    pub id: String,
    /// Its name, as jobs tell it; several may have the same.
    pub name: String,
    /// Its version.
    #[schema(example = "0.1.0")]
    pub version: String,
    /// Name of its device; null where its version does not tell.
    pub device: Option<String>,
    /// When it was first heard of.
    #[schema(format = DateTime)]
    pub started_at: String,
    /// When it was last heard of: seconds ago, unless it was killed or has no connection to the store of jobs.
    #[schema(format = DateTime)]
    pub seen_at: String,
    /// Its running jobs, of all tenants.
    pub jobs: Vec<JobId>,
}

impl Store {
    /// Says every few seconds that this process works on jobs, by its name for clients and that of its device.
    pub async fn announce(&self, name: &str, device: &str) -> Result<()> {
        let (name, device) = (name.to_owned(), device.to_owned());
        let announced = self.change("announce", move |change| {
            let now = change.now()?;
            let sql = "INSERT INTO workers (id, name, version, device, started_at, seen_at) \
                VALUES ($1, $2, $3, $4, $5, $5) ON CONFLICT (id) DO UPDATE SET name = excluded.name, \
                device = excluded.device, seen_at = excluded.seen_at";
            change.rows.write(sql, values![change.me, &*name, env!("CARGO_PKG_VERSION"), &*device, now])?;
            // a worker that was killed leaves its row
            let sql = "DELETE FROM workers WHERE seen_at < $1 \
                AND NOT EXISTS (SELECT 1 FROM jobs WHERE worker_id = workers.id AND state = 'running')";
            change.rows.write(sql, values![now - Duration::from_secs(3600)])
        });
        announced.await
    }

    /// The workers that were heard of in the last five minutes or have jobs, the oldest first.
    pub async fn workers(&self) -> Result<Vec<Worker>> {
        let found = self.read("workers", |rows| {
            let since = rows.now()? - Duration::from_secs(300);
            let sql = "SELECT worker_id, id FROM jobs WHERE state = 'running' ORDER BY number";
            let mut jobs = HashMap::<Option<Uuid>, Vec<JobId>>::new();
            for row in rows.query(sql, Vec::new())? {
                jobs.entry(row.get("worker_id")?).or_default().push(row.get("id")?);
            }
            let mut workers = Vec::new();
            for row in rows.query("SELECT * FROM workers ORDER BY started_at, id", Vec::new())? {
                let jobs = jobs.remove(&row.get("id")?).unwrap_or_default();
                if row.get::<SystemTime>("seen_at")? > since || !jobs.is_empty() {
                    workers.push(read!(row, Worker {
                        id, name, version, device;
                        started_at: rfc3339(row.get("started_at")?),
                        seen_at: rfc3339(row.get("seen_at")?),
                        jobs: jobs,
                    }));
                }
            }
            Ok(workers)
        });
        found.await
    }

    /// Whether this process is the one that cleans up for all: deletes jobs that expired, sweeps files of no job,
    /// delivers webhooks. Another one may 90 seconds after this one last called it.
    pub async fn may_clean_up(&self) -> Result<bool> {
        if !self.is_shared() {
            return Ok(true);
        }
        let taken = self.change("may_clean_up", |change| {
            let now = change.now()?;
            let sql = "UPDATE identity SET cleaner = $1, cleans_until = $2 \
                WHERE cleaner IS NULL OR cleaner = $1 OR cleans_until <= $3 RETURNING id";
            Ok(change.rows.first(sql, values![change.me, now + Duration::from_secs(90), now])?.is_some())
        });
        taken.await
    }

    pub(super) async fn leave(&self) -> Result<()> {
        let left = self.change("close", |change| {
            let me = change.me;
            change.rows.write("UPDATE identity SET cleaner = NULL WHERE cleaner = $1", values![me])?;
            let sql = "DELETE FROM workers WHERE id = $1 \
                       AND NOT EXISTS (SELECT 1 FROM jobs WHERE worker_id = $1 AND state = 'running')";
            change.rows.write(sql, values![me])
        });
        left.await
    }

    /// Changes whenever a job with a webhook ended: the delivery task waits for it. Marked as changed from the start.
    pub fn endings(&self) -> watch::Receiver<()> {
        marked(&self.listeners.endings)
    }

    /// Jobs whose webhook is not settled, in the order of their ends, deleted jobs included; none where another service
    /// [cleans up](Self::may_clean_up). As durable as jobs.
    pub async fn untold(&self) -> Result<Vec<JobId>> {
        if !self.may_clean_up().await? {
            return Ok(Vec::new());
        }
        let rows = self.query("untold", "SELECT job FROM notices ORDER BY place", Vec::new()).await?;
        rows.iter().map(|row| row.get("job")).collect()
    }

    /// The notice of one of the [untold](Self::untold) jobs; none for another job.
    pub async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        let sql = "SELECT * FROM notices WHERE job = $1";
        self.query("notice", sql, values![id]).await?.first().map(Notice::of).transpose()
    }

    /// Removes the notice of the end of a job at `ended_at`: its webhook was delivered or given up. Nothing happens for
    /// an unknown job, or one that was retried and has ended again since.
    pub async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()> {
        let sql = "DELETE FROM notices WHERE job = $1 AND ended_at = $2";
        self.change("settle_webhook", move |change| change.rows.write(sql, values![id, ended_at])).await
    }
}
