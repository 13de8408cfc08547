//! Workers: what is known about them.

use super::*;
use crate::store::Worker;

async fn announced(store: &Store) -> Worker {
    store.announce("w", "a device").await.expect("announced");
    let mut workers = store.workers().await.expect("readable");
    assert_eq!(workers.len(), 1, "{workers:?}");
    workers.remove(0)
}

pub(super) async fn a_worker_is_known_with_its_jobs(store: &Store) {
    assert_eq!(store.workers().await, Ok(vec![]), "it was not announced");
    let worker = announced(store).await;
    assert_eq!(
        (&*worker.name, &*worker.version, worker.device.as_deref()),
        ("w", env!("CARGO_PKG_VERSION"), Some("a device"))
    );
    assert!(worker.jobs.is_empty());
    for _ in 0..2 {
        create(store).await;
    }
    let (ticket, job) = claim(store).await;
    let again = announced(store).await;
    assert_eq!((again.id, again.started_at, &*again.jobs), (worker.id, worker.started_at, &[job.id][..]));
    assert!(again.seen_at >= worker.seen_at);
    store.finish(ticket, End::Cancelled).await.expect("finished");
    assert!(announced(store).await.jobs.is_empty());
}
