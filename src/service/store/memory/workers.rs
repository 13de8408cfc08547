//! The one worker.

use async_trait::async_trait;

use super::super::{Presence, Worker, WorkerId, Workers};
use super::MemoryStore;
use crate::error::Result;

#[async_trait]
impl Workers for MemoryStore {
    async fn announce(&self, presence: &Presence) -> Result<()> {
        self.worker.announce(presence);
        Ok(())
    }

    async fn workers(&self) -> Result<Vec<Worker>> {
        Ok(self.worker.worker(self).await?.into_iter().collect())
    }

    async fn drain(&self, id: WorkerId, drains: bool) -> Result<Option<Worker>> {
        if !self.worker.drain(id, drains) {
            return Ok(None);
        }
        self.jobs.lock().arrivals.notify();
        self.worker.worker(self).await
    }
}
