//! Jobs of workers that were lost: those whose leases are over by the clock of the database.
//!
//! One service at a time looks. While the server of the database was stopped no worker could prolong a lease, so a
//! lease that was over when the server started is valid for another term.

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

use super::super::{Ticket, guilty};
use super::connections::{all, one};
use super::live::Live;
use super::replica::PostgresStore;
use super::rows::column;
use crate::error::Result;

/// Running jobs whose worker is gone, or gave them up.
const LOST: &str = "SELECT jobs.id, jobs.state, jobs.attempt, jobs.uncounted, jobs.begun, jobs.suspicion, \
    jobs.cancel_requested, jobs.last_seq, jobs.boot, jobs.started_at, \
    workers.id IS NULL OR workers.alive_until <= clock_timestamp() AS is_gone \
    FROM jobs LEFT JOIN workers ON workers.id = jobs.boot \
    WHERE jobs.state = 'running' AND jobs.lease_until <= clock_timestamp() \
    AND (jobs.lease_until > pg_postmaster_start_time() \
         OR pg_postmaster_start_time() + coalesce(workers.lease, '0') < clock_timestamp()) \
    AND (workers.id IS NULL OR workers.alive_until <= clock_timestamp() \
         OR jobs.lease_until <= workers.alive_until - workers.lease / 2) \
    ORDER BY jobs.number FOR UPDATE OF jobs";

impl PostgresStore {
    /// Gives back the jobs of lost workers; the tickets that held them.
    pub(super) async fn give_back_lost(&self) -> Result<Vec<Ticket>> {
        let rules = self.rules;
        let lost = self.change(|transaction, effects| {
            Box::pin(async move {
                let row = one(transaction, "SELECT pg_try_advisory_xact_lock(1953723250, 2) AS is_mine", &[]).await?;
                if !column::<bool>(&row, "is_mine")? {
                    return Ok(Vec::new());
                }
                let mut lost = Vec::new();
                let mut workers = BTreeMap::<_, Vec<(Live, Option<SystemTime>)>>::new();
                for row in &all(transaction, LOST, &[]).await? {
                    let job = Live::from_row(row)?;
                    lost.push(job.ticket());
                    match column::<bool>(row, "is_gone")? {
                        true => workers.entry(job.boot).or_default().push((job, column(row, "started_at")?)),
                        false if job.has_begun => {
                            job.abandoned(transaction, &rules, Duration::ZERO, effects).await?;
                        }
                        false => {
                            let mut job = job;
                            job.free(transaction, Duration::ZERO, effects).await?;
                        }
                    }
                }
                for jobs in workers.into_values() {
                    let begun: Vec<_> = jobs.iter().filter(|(job, _)| job.has_begun).collect();
                    let starts: Vec<_> = begun.iter().map(|(job, started)| (job.suspicion, *started)).collect();
                    let guilty = guilty(&starts).map(|index| begun[index].0.id);
                    for (job, _) in jobs {
                        let is_guilty = guilty == Some(job.id);
                        job.crashed(transaction, is_guilty, &rules, effects).await?;
                    }
                }
                Ok(lost)
            })
        });
        let lost = lost.await?;
        self.held.lock().retain(|ticket, _| !lost.contains(ticket));
        Ok(lost)
    }
}
