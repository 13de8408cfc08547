//! Workers: what is known about them, and draining.

use super::*;
use crate::service::store::{Presence, Worker, WorkerId};

async fn announced(store: &dyn JobStore) -> Worker {
    let presence = Presence { name: "w".into(), version: "1.2.3", device: "a device".into() };
    store.announce(&presence).await.expect("announced");
    let mut workers = store.workers().await.expect("readable");
    assert_eq!(workers.len(), 1, "{workers:?}");
    workers.remove(0)
}

pub(super) async fn a_worker_is_known_with_its_jobs(store: &dyn JobStore) {
    assert_eq!(store.workers().await, Ok(vec![]), "it was not announced");
    let worker = announced(store).await;
    assert_eq!((&*worker.name, &*worker.version, worker.device.as_deref()), ("w", "1.2.3", Some("a device")));
    assert!(worker.jobs.is_empty() && !worker.drains);
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

pub(super) async fn a_worker_that_drains_claims_nothing(store: &dyn JobStore) {
    let other: WorkerId = "00000000-0000-4000-8000-000000000000".parse().expect("an id");
    assert_eq!(store.drain(other, true).await, Ok(None));
    let id = announced(store).await.id;
    for _ in 0..2 {
        create(store).await;
    }
    let (ticket, job) = claim(store).await;
    let draining = store.drain(id, true).await.expect("writable").expect("the worker");
    assert_eq!((draining.id, draining.drains, draining.jobs), (id, true, vec![job.id]));
    assert!(store.claim(9, LEASE).await.expect("no error").is_empty());
    // it keeps the job that it has, and goes on saying that it is there
    assert_eq!(store.heartbeat(&[ticket], LEASE).await, Ok(vec![]));
    assert!(announced(store).await.drains);
    store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
    assert!(store.claim(9, LEASE).await.expect("no error").is_empty());
    let mut arrivals = store.arrivals();
    arrivals.borrow_and_update();
    assert!(!store.drain(id, false).await.expect("writable").expect("the worker").drains);
    let woken = tokio::time::timeout(Duration::from_secs(30), arrivals.changed()).await;
    woken.expect("a worker looks again").expect("still there");
    assert_eq!(store.claim(9, LEASE).await.expect("claimable").len(), 1);
}
