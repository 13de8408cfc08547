//! Reservations of uploads by URL.

use std::time::{Duration, SystemTime};

use async_trait::async_trait;

use super::super::{JobId, Reservation, Reservations};
use super::MemoryStore;
use crate::error::Result;

#[async_trait]
impl Reservations for MemoryStore {
    async fn reserve(&self, id: JobId, reservation: Reservation, valid: Duration) -> Result<()> {
        let (reservations, now) = (&mut self.jobs.lock().reservations, SystemTime::now());
        reservations.retain(|_, (_, until)| *until + valid > now);
        reservations.insert(id, (reservation, now + valid));
        Ok(())
    }

    async fn reservation(&self, id: JobId) -> Result<Option<Reservation>> {
        let found = self.jobs.lock().reservations.get(&id).cloned();
        Ok(found.map(|(reservation, until)| Reservation { is_over: until <= SystemTime::now(), ..reservation }))
    }

    async fn unreserve(&self, id: JobId) -> Result<bool> {
        Ok(self.jobs.lock().reservations.remove(&id).is_some())
    }

    async fn waiting_of(&self, tenant: &str) -> Result<u64> {
        let (jobs, now) = (self.jobs.lock(), SystemTime::now());
        let is_its = |(reservation, until): &&(Reservation, SystemTime)| reservation.tenant == tenant && *until > now;
        let reserved = jobs.reservations.values().filter(is_its).count();
        Ok((jobs.queues.get(tenant).map_or(0, |queue| queue.waiting.len()) + reserved) as u64)
    }
}
