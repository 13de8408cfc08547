//! Limits of waiting jobs: of one tenant here, of all tenants in the store.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;
use tesserae_mesh::error::{Error, Kind};

use crate::guard::access::tokens::Tenant;
use crate::guard::problem::Failure;
use crate::metrics::Metrics;
use crate::store::{LOCAL_TENANT, Store};

/// Admits jobs to the queue.
#[derive(Debug)]
pub(crate) struct Admission {
    store: Arc<Store>,
    metrics: Arc<Metrics>,
    /// Most waiting jobs of a tenant whose quotas have no number.
    most: u64,
    creating: Arc<Creating>,
}

/// Jobs that are being created, by tenant: they count as waiting jobs.
#[derive(Debug, Default)]
struct Creating(Mutex<HashMap<String, u64>>);

/// The place of a job that is being created, until it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    creating: Arc<Creating>,
    tenant: String,
}

impl Admission {
    /// Allows `most` waiting jobs of a tenant whose quotas have no number.
    pub fn new(store: Arc<Store>, metrics: Arc<Metrics>, most: u64) -> Self {
        Self { store, metrics, most, creating: Arc::default() }
    }

    /// Refuses a job before its upload is read when there is no room for it now.
    pub async fn check(&self, tenant: &Tenant) -> Result<(), Failure> {
        let checked = self.store.check_room().await;
        if let Err(error) = checked {
            return Err(self.full(error).await);
        }
        self.check_tenant(tenant, 0).await
    }

    /// Takes a place for a job that is about to be created. A tenant never exceeds its limit, however many of its jobs
    /// are created at once; near the limit, some of these may be refused that would have fitted.
    pub async fn place(&self, tenant: &Tenant) -> Result<Place, Failure> {
        let place = Place { creating: Arc::clone(&self.creating), tenant: tenant.name.clone() };
        let others = {
            let mut creating = self.creating.0.lock();
            let count = creating.entry(tenant.name.clone()).or_default();
            *count += 1;
            *count - 1
        };
        // those that wait are counted after `others`: one that left `creating` meanwhile is counted there
        self.check_tenant(tenant, others).await?;
        Ok(place)
    }

    /// The answer to a job for which the queue has no room.
    pub async fn full(&self, error: Error) -> Failure {
        let depth = match error.kind {
            Kind::QueueFull => self.store.waiting().await.ok(),
            _ => None,
        };
        let retry_after = depth.and_then(|depth| self.metrics.seconds_to_empty(depth));
        Failure { queue_depth: depth, retry_after, ..error.into() }
    }

    /// Refuses one more job of a tenant that has as many waiting as it may, `creating` more included.
    async fn check_tenant(&self, tenant: &Tenant, creating: u64) -> Result<(), Failure> {
        // without tokens all clients are this tenant: the limit of the whole queue is enough
        if tenant.name == LOCAL_TENANT && tenant.quotas.max_queued_jobs.is_none() {
            return Ok(());
        }
        let quota = tenant.quotas.max_queued_jobs.unwrap_or(self.most);
        let depth = self.store.waiting_of(&tenant.name).await?;
        if depth + creating < quota {
            return Ok(());
        }
        let message = format_args!("as many jobs of this tenant wait as may; try again later: {quota}");
        let error = Error::new(Kind::QueueFull, message);
        Err(Failure { queue_depth: Some(depth), retry_after: self.metrics.seconds_to_empty(depth), ..error.into() })
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::{new_job, store_in};
    use crate::store::{NewJob, Spec};
    use tesserae_mesh::report::{DeviceInfo, DeviceKind};

    #[tokio::test]
    async fn jobs_that_are_created_at_once_are_not_more_than_may_wait() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Arc::new(store_in(folder.path()).await);
        let spec = Spec { tenant: "acme".to_owned(), ..new_job().spec };
        store.create(NewJob { spec, ..new_job() }).await.expect("created");
        let [name, backend, driver] = [(); 3].map(|()| "x".to_owned());
        let device = DeviceInfo { kind: DeviceKind::Cpu, name, backend, driver };
        let admission = Admission::new(store, Arc::new(Metrics::new(&device)), 4);
        let tenant = Tenant { name: "acme".to_owned(), quotas: Default::default(), metrics: false };
        let at_once = futures_util::future::join_all((0..16).map(|_| admission.place(&tenant))).await;
        let (mut places, refused): (Vec<_>, Vec<_>) = at_once.into_iter().partition(Result::is_ok);
        assert!(places.len() <= 3, "{} beside a job", places.len());
        assert!(refused.into_iter().all(|refused| refused.expect_err("refused").error.kind == Kind::QueueFull));
        while places.len() < 3 {
            places.push(Ok(admission.place(&tenant).await.expect("it fits")));
        }
        assert_eq!(admission.place(&tenant).await.expect_err("full").error.kind, Kind::QueueFull);
        admission.check(&tenant).await.expect("one waits, and the others are not created yet");
        places.pop();
        admission.place(&tenant).await.expect("a place is free");
    }
}
