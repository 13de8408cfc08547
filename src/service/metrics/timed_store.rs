//! A store whose operations are timed.

use std::sync::Arc;
use std::time::Instant;

use async_trait::async_trait;
use tokio::sync::watch;

use super::Metrics;
use crate::error::Result;
use crate::service::store::{
    Deletion, End, Event, Job, JobId, JobStore, ListQuery, Page, Progress, Pulse, Spec, State, Ticket, What,
};

/// Another store, timed.
#[derive(Debug)]
pub(in crate::service) struct TimedStore<S> {
    store: S,
    metrics: Arc<Metrics>,
}

impl<S: JobStore> TimedStore<S> {
    /// Times `store`.
    pub fn new(store: S, metrics: Arc<Metrics>) -> Self {
        Self { store, metrics }
    }

    async fn timed<T>(&self, operation: &'static str, work: impl Future<Output = Result<T>> + Send) -> Result<T> {
        let started = Instant::now();
        let result = work.await;
        // a full queue, a stale ticket and the like are answers, not failures
        let failed = result.as_ref().is_err_and(|error| matches!(error.kind.status(), 500 | 503 | 507));
        self.metrics.stored(operation, started.elapsed(), failed);
        result
    }
}

#[async_trait]
impl<S: JobStore> JobStore for TimedStore<S> {
    async fn check_room(&self) -> Result<()> {
        self.timed("check_room", self.store.check_room()).await
    }

    async fn create(&self, id: JobId, spec: Spec) -> Result<Job> {
        self.timed("create", self.store.create(id, spec)).await
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        self.timed("get", self.store.get(id)).await
    }

    async fn list(&self, query: &ListQuery) -> Result<Page> {
        self.timed("list", self.store.list(query)).await
    }

    async fn claim(&self) -> Result<Option<(Ticket, Job)>> {
        self.timed("claim", self.store.claim()).await
    }

    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        self.timed("append", self.store.append(ticket, events, progress)).await
    }

    async fn finish(&self, ticket: Ticket, end: End) -> Result<()> {
        self.timed("finish", self.store.finish(ticket, end)).await
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        self.timed("cancel", self.store.cancel(id)).await
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        self.timed("delete", self.store.delete(id)).await
    }

    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        self.timed("events", self.store.events(id, after, limit)).await
    }

    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        self.timed("watch", self.store.watch(id)).await
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        self.store.arrivals()
    }

    fn endings(&self) -> watch::Receiver<u64> {
        self.store.endings()
    }

    async fn untold(&self) -> Result<Vec<JobId>> {
        self.timed("untold", self.store.untold()).await
    }

    async fn settle_webhook(&self, id: JobId) -> Result<()> {
        self.timed("settle_webhook", self.store.settle_webhook(id)).await
    }

    async fn queued_of(&self, tenant: &str) -> Result<u64> {
        self.timed("queued_of", self.store.queued_of(tenant)).await
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        self.timed("counts", self.store.counts()).await
    }
}
