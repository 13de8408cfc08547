//! Limits of waiting jobs: of one tenant here, of all tenants in the store. An upload by URL that no job is made of yet
//! counts as a waiting job of its tenant.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;

use super::access::tokens::Tenant;
use super::blobs::PutUrl;
use super::files::Files;
use super::metrics::Metrics;
use super::problem::Failure;
use super::store::{JobId, LOCAL_TENANT, RESERVED_FOR, Reservation, Reservations, State};
use crate::error::{Error, Kind};

/// Admits jobs to the queue.
#[derive(Debug)]
pub(super) struct Admission {
    store: Arc<dyn Reservations>,
    metrics: Arc<Metrics>,
    /// Most waiting jobs of a tenant whose quotas have no number.
    most: u64,
    creating: Arc<Creating>,
}

/// Jobs and reservations that are being created, by tenant: they count as waiting jobs.
#[derive(Debug, Default)]
struct Creating(Mutex<HashMap<String, u64>>);

/// The place of a job that is being created, until it is dropped.
#[derive(Debug)]
pub(super) struct Place {
    creating: Arc<Creating>,
    tenant: String,
}

impl Admission {
    /// Allows `most` waiting jobs of a tenant whose quotas have no number.
    pub fn new(store: Arc<dyn Reservations>, metrics: Arc<Metrics>, most: u64) -> Self {
        Self { store, metrics, most, creating: Arc::default() }
    }

    /// Refuses a job before its upload is read when there is no room for it now. With `is_reserved`, the job's
    /// reservation counts already, and the tenant's limit is not checked.
    pub async fn check(&self, tenant: &Tenant, is_reserved: bool) -> Result<(), Failure> {
        let checked = self.store.check_room().await;
        if let Err(error) = checked {
            return Err(self.full(error).await);
        }
        if is_reserved { Ok(()) } else { self.check_tenant(tenant, 0).await }
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
            Kind::QueueFull => self.store.counts().await.ok().map(|counts| counts[State::Queued as usize]),
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
        self.check_quota(tenant, creating + 1).await
    }

    /// Reserves an upload by URL. What waits is counted again afterwards: reserving takes no tenant above its limit,
    /// however many services reserve at once; near the limit, some may be refused that would have fitted.
    pub async fn reserve(
        &self,
        files: &Files,
        tenant: &Tenant,
        bytes: u64,
        file_name: Option<String>,
    ) -> Result<(JobId, PutUrl), Failure> {
        let _place = self.place(tenant).await?;
        let id = JobId::random();
        let url = files.put_url(id, bytes).await?;
        let reservation = Reservation { tenant: tenant.name.clone(), bytes, file_name, is_over: false };
        let fits = match self.store.reserve(id, reservation, RESERVED_FOR).await {
            Ok(()) => self.check_quota(tenant, 0).await,
            Err(error) => Err(error.into()),
        };
        if let Err(refusal) = fits {
            if let Err(error) = self.store.unreserve(id).await {
                tracing::warn!(%id, %error, "a refused upload counts until its reservation is over");
            }
            return Err(refusal);
        }
        Ok((id, url))
    }

    /// Refuses when a tenant would have more than it may with `more` than now.
    async fn check_quota(&self, tenant: &Tenant, more: u64) -> Result<(), Failure> {
        let quota = tenant.quotas.max_queued_jobs.unwrap_or(self.most);
        let depth = self.store.waiting_of(&tenant.name).await?;
        if depth + more <= quota {
            return Ok(());
        }
        let message = format_args!("as many jobs and uploads of this tenant wait as may; try again later: {quota}");
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
    use crate::report::{DeviceInfo, DeviceKind};
    use crate::service::store::memory::MemoryStore;
    use crate::service::store::tests::{RULES, new_job};
    use crate::service::store::{NewJob, Queue as _, Spec};

    #[tokio::test]
    async fn uploads_that_are_reserved_at_once_are_not_more_than_jobs_may_wait() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = [(); 2].map(|()| Files::with_urls(folder.path()));
        let store = Arc::new(MemoryStore::new(RULES).expect("a store"));
        let spec = Spec { tenant: "acme".to_owned(), ..new_job().spec };
        store.create(NewJob { spec, ..new_job() }).await.expect("created");
        let [name, backend, driver] = [(); 3].map(|()| "x".to_owned());
        let device = DeviceInfo { kind: DeviceKind::Cpu, name, backend, driver };
        let services = [(); 2].map(|()| Admission::new(store.clone(), Arc::new(Metrics::new(&device)), 4));
        let tenant = Tenant { name: "acme".to_owned(), quotas: Default::default(), metrics: false, admin: false };
        let reserve = |number: usize| services[number % 2].reserve(&files[number % 2], &tenant, 1, None);
        let at_once = futures_util::future::join_all((0..16).map(reserve)).await;
        let passed = at_once.iter().filter(|reserved| reserved.is_ok()).count() as u64;
        assert!(passed <= 3, "{passed} beside a job");
        assert_eq!(store.waiting_of("acme").await, Ok(1 + passed));
        for _ in passed..3 {
            reserve(0).await.expect("it fits");
        }
        let job = services[0].place(&tenant).await.expect_err("what is reserved counts for jobs, too");
        services[0].check(&tenant, true).await.expect("the job of an upload takes the place of that");
        let full = reserve(1).await.expect_err("full");
        assert_eq!(job.error.kind, full.error.kind);
        assert_eq!(full.error.kind, Kind::QueueFull);
        assert_eq!(store.waiting_of("acme").await, Ok(4));
    }
}
