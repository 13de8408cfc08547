//! Claims: what the statement of a claim takes and gives.

use std::sync::Arc;
use std::time::Duration;

use uuid::Uuid;

use super::super::{ALONE, ALONE_FROM, Claiming, Job, Ticket};
use super::connections::{Failure, all, execute};
use super::live::{Effects, Live, live};
use super::replica::PostgresStore;
use super::rows;
use crate::error::{Error, Result};

const CLAIM: &str = "SELECT * FROM claim_2($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)";

/// The change that waits for the disk: see the [module](super).
const SECURE: &str = "UPDATE workers SET claims = claims + 1 WHERE id = $1";

impl PostgresStore {
    /// Claims jobs, in the order that the [store](super::super) describes.
    pub(super) async fn claim_jobs(&self, claiming: &Claiming) -> Result<Vec<(Ticket, Job)>> {
        let mut is_unsure = self.is_unsure.lock().await;
        if std::mem::replace(&mut *is_unsure, true) {
            self.give_back_unknown().await?;
        }
        let most = i32::try_from(claiming.limit).unwrap_or(i32::MAX);
        let newcomers = i32::try_from(claiming.newcomers).unwrap_or(i32::MAX);
        let (mut tenants, mut weights, mut limits) = (Vec::new(), Vec::new(), Vec::new());
        for (tenant, share) in claiming.shares.iter() {
            tenants.push(tenant);
            weights.push(i64::from(share.weight));
            limits.push(share.max_running.map(|limit| i64::try_from(limit).unwrap_or(i64::MAX)));
        }
        let (tenants, weights, limits) = (&tenants, &weights, &limits);
        let claimed = self.connections.run(|client| async move {
            let rows = all(
                &client,
                CLAIM,
                &[
                    &self.me,
                    &&*claiming.worker,
                    &env!("CARGO_PKG_VERSION"),
                    &claiming.lease.as_secs_f64(),
                    &most,
                    &newcomers,
                    &ALONE.as_secs_f64(),
                    &(ALONE_FROM as i32),
                    tenants,
                    weights,
                    limits,
                ],
            )
            .await?;
            let mut claimed = Vec::new();
            for row in &rows {
                let job = rows::unplaced(row)?;
                claimed.push((Ticket { job: job.id, attempt: job.attempt }, rows::count(row, "last_seq")?, job));
            }
            if !claimed.is_empty() {
                // not to be repeated together with the claim
                execute(&client, SECURE, &[&self.me]).await.map_err(Error::from)?;
            }
            Ok(claimed)
        });
        let claimed = claimed.await?;
        *is_unsure = false;
        let mut effects = Effects::default();
        let mut held = self.held.lock();
        let mut tickets = Vec::new();
        for (ticket, last_seq, job) in claimed {
            held.insert(ticket, last_seq);
            effects.pulses.push((ticket.job, super::super::Pulse { last_seq, ..Default::default() }));
            tickets.push((ticket, job));
        }
        drop(held);
        self.follow(&effects);
        Ok(tickets)
    }

    /// Gives back the jobs that a claim without an answer took.
    async fn give_back_unknown(&self) -> Result<()> {
        let me = self.me;
        let known: Arc<Vec<Uuid>> = Arc::new(self.held.lock().keys().map(|ticket| ticket.job.uuid()).collect());
        let given_back = self.change(|transaction, effects| {
            let known = Arc::clone(&known);
            Box::pin(async move {
                let sql = live!("WHERE boot = $1 AND state = 'running' AND NOT id = ANY ($2) FOR UPDATE");
                let rows = all(transaction, sql, &[&me, &*known]).await?;
                for row in &rows {
                    Live::from_row(row)?.free(transaction, Duration::ZERO, effects).await?;
                }
                Ok::<_, Failure>(rows.len())
            })
        });
        let jobs = given_back.await?;
        if jobs > 0 {
            tracing::info!(jobs, "claims without an answer were given back");
        }
        Ok(())
    }
}
