//! A store whose operations are timed.

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use async_trait::async_trait;
use tokio::sync::watch;
use tokio_util::bytes::Bytes;

use super::Metrics;
use crate::error::Result;
use crate::service::store::{
    Claiming, Created, Deletion, Ending, Event, Events, Job, JobId, JobStore, ListQuery, Maintenance, NewJob, Notice,
    Notices, Page, Presence, Progress, Pulse, Queue, Release, Retried, State, Statistics, Ticket, What, Worker,
    Workers,
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

/// Implements a part of the store: each operation under its label in the metrics, and what is too short to be timed.
macro_rules! timed {
    ($part:ident {
        $($label:literal: $name:ident($($argument:ident: $type:ty),*) -> $output:ty;)*
    } and {
        $($untimed:tt)*
    }) => {
        #[async_trait]
        impl $part for TimedStore {
            $(async fn $name(&self, $($argument: $type),*) -> Result<$output> {
                self.timed($label, self.store.$name($($argument),*)).await
            })*

            $($untimed)*
        }
    };
}

timed!(Queue {
    "check_room": check_room() -> ();
    "knows_key": knows_key(tenant: &str, key: &str) -> bool;
    "create": create(job: NewJob) -> Created;
    "get": get(id: JobId) -> Option<Job>;
    "list": list(query: &ListQuery) -> Page;
    "claim": claim_as(claiming: Claiming) -> Vec<(Ticket, Job)>;
    "begin": begin(ticket: Ticket) -> ();
    "retry": retry(id: JobId) -> Retried;
    "heartbeat": heartbeat(tickets: &[Ticket], lease: Duration) -> Vec<Ticket>;
    "release": release(ticket: Ticket, release: Release) -> State;
    "reclaim": reclaim() -> Vec<Ticket>;
    "finish": end(ticket: Ticket, ending: Ending) -> ();
    "blob": blob(id: JobId, name: &str) -> Option<Bytes>;
    "cancel": cancel(id: JobId) -> Option<Job>;
    "counts": counts() -> [u64; State::ALL.len()];
    "waiting_of": waiting_of(tenant: &str) -> u64;
    "oldest_queued": oldest_queued() -> Option<SystemTime>;
} and {
    fn next_start(&self) -> Option<Duration> {
        self.store.next_start()
    }

    fn takes(&self, bytes: u64) -> bool {
        self.store.takes(bytes)
    }

    fn arrivals(&self) -> watch::Receiver<u64> {
        self.store.arrivals()
    }
});

timed!(Events {
    "append": append(ticket: Ticket, events: Vec<What>, progress: Progress) -> ();
    "events": events(id: JobId, after: u64, limit: usize) -> Option<Vec<Event>>;
    "watch": watch(id: JobId) -> Option<watch::Receiver<Pulse>>;
} and {});

timed!(Notices {
    "untold": untold() -> Vec<JobId>;
    "notice": notice(id: JobId) -> Option<Notice>;
    "settle_webhook": settle_webhook(id: JobId, ended_at: SystemTime) -> ();
} and {
    fn endings(&self) -> watch::Receiver<u64> {
        self.store.endings()
    }
});

timed!(Workers {
    "announce": announce(presence: &Presence) -> ();
    "workers": workers() -> Vec<Worker>;
} and {});

timed!(Maintenance {
    "free_bytes": free_bytes() -> u64;
    "give_back": give_back() -> ();
    "delete": delete(id: JobId) -> Deletion;
    "ended_before": ended_before(time: SystemTime, limit: usize) -> Vec<JobId>;
    "probe": probe() -> ();
    "may_clean_up": may_clean_up() -> bool;
} and {
    fn is_shared(&self) -> bool {
        self.store.is_shared()
    }

    fn is_durable(&self) -> bool {
        self.store.is_durable()
    }

    fn statistics(&self) -> Statistics {
        self.store.statistics()
    }

    async fn close(&self) {
        self.store.close().await;
    }
});
