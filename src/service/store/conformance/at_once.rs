//! Many operations at once, what claims of many jobs cost, and repeated requests.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Instant;

use tokio::task::JoinSet;

use super::super::Claiming;
use super::*;

pub(super) async fn a_key_stands_for_one_request(store: &Store) {
    assert!(!store.knows_key("a", "k").await.expect("readable"));
    let first = add_new(store, with_key("a", "k", "digest")).await;
    assert!(store.knows_key("a", "k").await.expect("readable"));
    let again = store.create(with_key("a", "k", "digest")).await.expect("known");
    assert_eq!(again, Created::Known(first.clone()));
    let other = store.create(with_key("a", "k", "another digest")).await.expect_err("another request");
    assert_eq!(other.kind, Kind::KeyReused);
    assert!(other.message.contains("\"k\""), "{other}");
    // keys are a tenant's own
    add_new(store, with_key("b", "k", "another digest")).await;
    assert_eq!(store.counts().await.expect("counted"), [2, 0, 0, 0, 0]);
    // the key stays with an ended job, and goes with it
    run_to(store, End::Succeeded(SUMMARY)).await;
    let again = store.create(with_key("a", "k", "digest")).await.expect("known");
    assert!(matches!(again, Created::Known(job) if job.id == first.id && job.state == State::Succeeded));
    store.delete(first.id).await.expect("deleted");
    add_new(store, with_key("a", "k", "another digest")).await;
}

pub(super) async fn the_same_key_at_once_gives_one_job(store: &Store) {
    let clients = join_all((0..40).map(async |client| {
        let key = ["p", "q"][client % 2];
        match store.create(with_key("a", key, "digest")).await.expect("created") {
            Created::New(job) | Created::Known(job) => (key, job.id),
        }
    }));
    let mut ids = clients.await;
    ids.sort();
    ids.dedup();
    assert_eq!(ids.iter().map(|(key, _)| *key).collect::<Vec<_>>(), ["p", "q"]);
    assert_eq!(store.counts().await.expect("counted"), [2, 0, 0, 0, 0]);
}

pub(super) async fn arrivals_wake_a_worker(store: &Store) {
    let mut arrivals = store.arrivals();
    assert!(arrivals.has_changed().expect("still there"), "a worker looks before it waits");
    arrivals.borrow_and_update();
    let worker = async {
        arrivals.changed().await.expect("still there");
        claim(store).await.0.job
    };
    let (claimed, job) = tokio::join!(biased; soon(worker), create(store));
    assert_eq!(claimed, job.id);
}

pub(super) async fn many_at_once_lose_nothing(store: Arc<Store>) {
    let (mut clients, mut workers) = (JoinSet::new(), JoinSet::new());
    let (ended, started) = (Arc::new(AtomicUsize::new(0)), Instant::now());
    for _ in 0..50 {
        let store = Arc::clone(&store);
        clients.spawn(async move { create(store.as_ref()).await.id });
    }
    for _ in 0..8 {
        let (store, ended) = (Arc::clone(&store), Arc::clone(&ended));
        workers.spawn(async move {
            let mut arrivals = store.arrivals();
            let mut claimed = Vec::new();
            while ended.load(Relaxed) < 50 && started.elapsed() < Duration::from_secs(120) {
                arrivals.borrow_and_update();
                while let Some((ticket, _)) = store.claim(1, LEASE).await.expect("claimable").pop() {
                    let row = vec![JobEvent::Iteration("{}".to_owned())];
                    store.append(ticket, row, Progress::default()).await.expect("appended");
                    store.end(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
                    claimed.push(ticket.job);
                    ended.fetch_add(1, Relaxed);
                }
                // the last arrival may wake another one
                let _ = tokio::time::timeout(Duration::from_millis(50), arrivals.changed()).await;
            }
            claimed
        });
    }
    let (mut created, mut claimed) = (clients.join_all().await, workers.join_all().await.concat());
    created.sort();
    claimed.sort();
    assert_eq!(created, claimed);
    for id in created {
        assert_eq!(events(store.as_ref(), id, 0, 99).await.len(), 4);
    }
}

/// How many jobs are claimed: `CLAIM_JOBS` says it for the figures in `docs/farm.md`.
pub(super) fn jobs() -> usize {
    std::env::var("CLAIM_JOBS").map_or(1200, |jobs| jobs.parse().expect("a number"))
}

/// Claims empty jobs, which all stores have, by one claimer a store, which ends them before it claims again.
pub(super) async fn claim_all(stores: &[Arc<Store>], limit: usize, jobs: usize) {
    let (mut creators, mut claimers) = (JoinSet::new(), JoinSet::new());
    for creator in 0..8 {
        let store = Arc::clone(&stores[creator % stores.len()]);
        creators.spawn(async move {
            for number in 0..jobs / 8 {
                let mut job = new_job();
                job.spec.tenant = format!("tenant {}", (creator + number) % 5);
                store.create(job).await.expect("created");
            }
        });
    }
    creators.join_all().await;
    let started = Instant::now();
    for (number, store) in stores.iter().map(Arc::clone).enumerate() {
        claimers.spawn(async move {
            let (mut claimed, mut claiming) = (Vec::new(), Duration::ZERO);
            let worker = format!("worker {number}").into();
            let request = Claiming { limit, newcomers: 0, lease: LEASE, worker, shares: Arc::default() };
            loop {
                let started = Instant::now();
                let taken = store.claim_as(request.clone()).await.expect("claimable").0;
                claiming += started.elapsed();
                if taken.is_empty() {
                    return (claimed, claiming);
                }
                for (ticket, _) in taken {
                    claimed.push(ticket.job);
                    store.end(ticket, End::Cancelled).await.expect("ended");
                }
            }
        });
    }
    let (claimed, times): (Vec<_>, Vec<Duration>) = claimers.join_all().await.into_iter().unzip();
    let (mut claimed, claiming) = (claimed.concat(), times.iter().sum::<Duration>());
    let rate = jobs as f64 / started.elapsed().as_secs_f64();
    let count = stores.len();
    println!("{limit} at a time: {rate:.0} jobs claimed and ended a second, {claiming:.1?} in claims of {count}");
    assert_eq!(claimed.len(), jobs);
    claimed.sort();
    claimed.dedup();
    assert_eq!(claimed.len(), jobs, "none twice");
    for id in claimed {
        assert_eq!(events(&stores[0], id, 0, 9).await.len(), 3);
    }
}
