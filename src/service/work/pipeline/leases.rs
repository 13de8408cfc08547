//! Leases: a task prolongs those of this process's jobs, returns jobs whose lease is over to the queue, and announces
//! the process for the list of workers. It runs on the runtime: a long step on the device costs no lease.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tesserae_mesh::error::Result;
use tokio_util::sync::CancellationToken;

use crate::store::{Store, Ticket};

/// A database may restart within a lease, and clients wait no longer for another worker.
pub(super) const TERM: Duration = Duration::from_secs(30);

/// Time until a prolongation that failed is tried again: other services may take the jobs once it can succeed.
const AGAIN: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
pub(crate) struct Leases {
    held: Mutex<HashMap<Ticket, CancellationToken>>,
}

impl Leases {
    /// Prolongs the lease of a job until this is dropped.
    pub fn hold(self: &Arc<Self>, ticket: Ticket) -> Lease {
        let lost = CancellationToken::new();
        self.held.lock().insert(ticket, lost.clone());
        Lease { leases: Arc::clone(self), ticket, lost }
    }

    /// Prolongs leases and reclaims those that are over, for a worker of that name on that device, until it is dropped.
    pub async fn keep(&self, store: &Store, worker: &str, device: &str) {
        loop {
            let kept = self.beat(store).await;
            // nothing depends on it, so that it may not delay the next beat
            let announced = tokio::time::timeout(AGAIN, store.announce(worker, device));
            if let Ok(Err(error)) = announced.await {
                tracing::debug!(%error, "the worker cannot be announced now");
            }
            // a store that fails costs no lease: no other process could take the job either
            if let Err(error) = &kept {
                tracing::warn!(%error, "leases cannot be prolonged or reclaimed now");
            }
            tokio::time::sleep(if kept.is_ok() { TERM / 3 } else { AGAIN }).await;
        }
    }

    async fn beat(&self, store: &Store) -> Result<()> {
        let tickets: Vec<Ticket> = self.held.lock().keys().copied().collect();
        if !tickets.is_empty() {
            store.heartbeat(&tickets, TERM).await?.into_iter().for_each(|ticket| self.lose(ticket));
        }
        for ticket in store.reclaim().await? {
            tracing::warn!(job = %ticket.job, "the lease of the job is over; it waits again");
            self.lose(ticket);
        }
        Ok(())
    }

    fn lose(&self, ticket: Ticket) {
        if let Some(lost) = self.held.lock().get(&ticket) {
            lost.cancel();
        }
    }
}

#[derive(Debug)]
pub(crate) struct Lease {
    leases: Arc<Leases>,
    ticket: Ticket,
    /// Cancelled when the job is no longer this process's.
    pub lost: CancellationToken,
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.leases.held.lock().remove(&self.ticket);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::{new_job, store_in};

    #[tokio::test]
    async fn held_leases_are_prolonged_and_others_reclaimed() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = store_in(folder.path()).await;
        for _ in 0..2 {
            store.create(new_job()).await.expect("created");
        }
        let claimed = store.claim(2, TERM).await.expect("claimable");
        let leases = Arc::new(Leases::default());
        let held = leases.hold(claimed[0].0);
        leases.beat(&store).await.expect("kept");
        assert_eq!(store.counts().await.expect("counted")[..2], [0, 2]);
        let both = [claimed[0].0, claimed[1].0];
        store.heartbeat(&both, Duration::ZERO).await.expect("both leases are over");
        leases.beat(&store).await.expect("kept");
        assert_eq!(store.counts().await.expect("counted")[..2], [1, 1], "the other one waits again");
        assert!(!held.lost.is_cancelled());
        store.end(claimed[0].0, crate::store::End::Cancelled).await.expect("finished");
        leases.beat(&store).await.expect("kept");
        held.lost.cancelled().await;
        drop(held);
        assert!(leases.held.lock().is_empty());
    }
}
