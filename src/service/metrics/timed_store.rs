//! A store whose operations are timed.

use std::sync::Arc;
use std::time::{Instant, SystemTime};

use async_trait::async_trait;
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use super::Metrics;
use crate::error::Result;
use crate::service::store::{
    Claiming, Created, Deletion, Ending, Event, Job, JobId, JobStore, ListQuery, NewJob, Notice, Page, Progress, Pulse,
    Release, Retried, State, Statistics, Ticket, What,
};

/// Another store, timed.
#[derive(Debug)]
pub(in crate::service) struct TimedStore {
    store: Arc<dyn JobStore>,
    metrics: Arc<Metrics>,
}

impl TimedStore {
    /// Times `store`.
    pub fn new(store: Arc<dyn JobStore>, metrics: Arc<Metrics>) -> Self {
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
impl JobStore for TimedStore {
    fn is_durable(&self) -> bool {
        self.store.is_durable()
    }

    async fn check_room(&self) -> Result<()> {
        self.timed("check_room", self.store.check_room()).await
    }

    async fn knows_key(&self, tenant: &str, key: &str) -> Result<bool> {
        self.timed("knows_key", self.store.knows_key(tenant, key)).await
    }

    async fn create(&self, job: NewJob) -> Result<Created> {
        self.timed("create", self.store.create(job)).await
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>> {
        self.timed("get", self.store.get(id)).await
    }

    async fn list(&self, query: &ListQuery) -> Result<Page> {
        self.timed("list", self.store.list(query)).await
    }

    async fn claim_as(&self, claiming: Claiming) -> Result<Vec<(Ticket, Job)>> {
        self.timed("claim", self.store.claim_as(claiming)).await
    }

    fn next_start(&self) -> Option<SystemTime> {
        self.store.next_start()
    }

    async fn begin(&self, ticket: Ticket) -> Result<()> {
        self.timed("begin", self.store.begin(ticket)).await
    }

    async fn retry(&self, id: JobId) -> Result<Retried> {
        self.timed("retry", self.store.retry(id)).await
    }

    async fn heartbeat(&self, tickets: &[Ticket], until: SystemTime) -> Result<Vec<Ticket>> {
        self.timed("heartbeat", self.store.heartbeat(tickets, until)).await
    }

    async fn release(&self, ticket: Ticket, release: Release) -> Result<State> {
        self.timed("release", self.store.release(ticket, release)).await
    }

    async fn reclaim(&self, now: SystemTime) -> Result<Vec<Ticket>> {
        self.timed("reclaim", self.store.reclaim(now)).await
    }

    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        self.timed("append", self.store.append(ticket, events, progress)).await
    }

    async fn end(&self, ticket: Ticket, ending: Ending) -> Result<()> {
        self.timed("finish", self.store.end(ticket, ending)).await
    }

    fn takes(&self, bytes: u64) -> bool {
        self.store.takes(bytes)
    }

    async fn blob(&self, id: JobId, name: &str) -> Result<Option<Bytes>> {
        self.timed("blob", self.store.blob(id, name)).await
    }

    async fn free_bytes(&self) -> Result<u64> {
        self.timed("free_bytes", self.store.free_bytes()).await
    }

    async fn cancel(&self, id: JobId) -> Result<Option<Job>> {
        self.timed("cancel", self.store.cancel(id)).await
    }

    async fn delete(&self, id: JobId) -> Result<Deletion> {
        self.timed("delete", self.store.delete(id)).await
    }

    async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        self.timed("ended_before", self.store.ended_before(time, limit)).await
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

    async fn notice(&self, id: JobId) -> Result<Option<Notice>> {
        self.timed("notice", self.store.notice(id)).await
    }

    async fn settle_webhook(&self, id: JobId, ended_at: SystemTime) -> Result<()> {
        self.timed("settle_webhook", self.store.settle_webhook(id, ended_at)).await
    }

    async fn queued_of(&self, tenant: &str) -> Result<u64> {
        self.timed("queued_of", self.store.queued_of(tenant)).await
    }

    async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        self.timed("counts", self.store.counts()).await
    }

    async fn oldest_queued(&self) -> Result<Option<SystemTime>> {
        self.timed("oldest_queued", self.store.oldest_queued()).await
    }

    async fn probe(&self) -> Result<()> {
        self.timed("probe", self.store.probe()).await
    }

    fn statistics(&self) -> Statistics {
        self.store.statistics()
    }

    async fn close(&self) {
        self.store.close().await;
    }
}
