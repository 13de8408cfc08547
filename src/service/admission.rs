//! How many jobs may wait: of one tenant here, of all in the store.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;

use super::access::tokens::Tenant;
use super::metrics::Metrics;
use super::problem::Failure;
use super::store::{LOCAL_TENANT, Queue, State};
use crate::error::{Error, Kind};

/// How many jobs wait, and how many more are being created.
#[derive(Debug)]
pub(super) struct Admission {
    store: Arc<dyn Queue>,
    metrics: Arc<Metrics>,
    /// Jobs of a tenant that may wait, unless its quotas say otherwise.
    most: u64,
    creating: Arc<Creating>,
}

/// Jobs that are being created, by tenant: they do not wait yet, but will.
#[derive(Debug, Default)]
struct Creating(Mutex<HashMap<String, u64>>);

/// The place of a job that is being created; given up when dropped.
#[derive(Debug)]
pub(super) struct Place {
    creating: Arc<Creating>,
    tenant: String,
}

impl Admission {
    /// Refuses jobs of a tenant beyond `most` that wait, unless its quotas say otherwise.
    pub fn new(store: Arc<dyn Queue>, metrics: Arc<Metrics>, most: u64) -> Self {
        Self { store, metrics, most, creating: Arc::default() }
    }

    /// Refuses a job, before its upload comes, for which there is no room now.
    pub async fn check(&self, tenant: &Tenant) -> Result<(), Failure> {
        let checked = self.store.check_room().await;
        if let Err(error) = checked {
            return Err(self.full(error).await);
        }
        self.check_tenant(tenant, 0).await
    }

    /// Takes the place of a job that is to be created now. A tenant never gets more than it may have, however many of its
    /// jobs are created at once; then some may be refused that would just have fitted.
    pub async fn place(&self, tenant: &Tenant) -> Result<Place, Failure> {
        let place = Place { creating: Arc::clone(&self.creating), tenant: tenant.name.clone() };
        let others = {
            let mut creating = self.creating.0.lock();
            let count = creating.entry(tenant.name.clone()).or_default();
            *count += 1;
            *count - 1
        };
        // counted only now, so that whoever gave up its place since is counted there
        self.check_tenant(tenant, others).await?;
        Ok(place)
    }

    /// The answer to a job for which the queue has no room.
    pub async fn full(&self, error: Error) -> Failure {
        let depth = match error.kind {
            Kind::QueueFull => self.store.counts().await.ok().map(|counts| counts[State::Queued as usize]),
            _ => None,
        };
        let retry_after = depth.and_then(|depth| self.metrics.seconds_to_empty(depth));
        Failure { queue_depth: depth, retry_after, ..error.into() }
    }

    /// Refuses one more job of a tenant that has as many waiting as it may, `creating` more included.
    async fn check_tenant(&self, tenant: &Tenant, creating: u64) -> Result<(), Failure> {
        let quota = match tenant.quotas.max_queued_jobs {
            Some(quota) => quota,
            // everybody, as far as is known: the limit of the whole queue will do
            None if tenant.name == LOCAL_TENANT => return Ok(()),
            None => self.most,
        };
        let depth = self.store.queued_of(&tenant.name).await?;
        if depth + creating < quota {
            return Ok(());
        }
        let message = format_args!("as many jobs of this tenant wait as may; try again later: {quota}");
        let error = Error::new(Kind::QueueFull, message);
        Err(Failure { queue_depth: Some(depth), retry_after: self.metrics.seconds_to_empty(depth), ..error.into() })
    }
}

impl Creating {}

impl Drop for Place {
    fn drop(&mut self) {
        let mut creating = self.creating.0.lock();
        if let Some(count) = creating.get_mut(&self.tenant) {
            *count -= 1;
            if *count == 0 {
                creating.remove(&self.tenant);
            }
        }
    }
}
