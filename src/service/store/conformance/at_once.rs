//! Many operations at once, and repeated requests.

use super::*;

pub(super) async fn a_key_stands_for_one_request(store: &Store) {
    assert!(!store.knows_key("a", "k").await.expect("readable"));
    let Created::New(first) = store.create(with_key("a", "k", "digest")).await.expect("created") else {
        panic!("the key is new")
    };
    assert!(store.knows_key("a", "k").await.expect("readable"));
    let again = store.create(with_key("a", "k", "digest")).await.expect("known");
    assert_eq!(again, Created::Known(first.clone()));
    let other = store.create(with_key("a", "k", "another digest")).await.expect_err("another request");
    assert_eq!(other.kind, Kind::KeyReused);
    assert!(other.message.contains("\"k\""), "{other}");
    // keys are a tenant's own
    assert!(matches!(store.create(with_key("b", "k", "another digest")).await, Ok(Created::New(_))));
    assert_eq!(store.counts().await.expect("counted"), [2, 0, 0, 0, 0]);
    // the key stays with an ended job, and goes with it
    let (ticket, _) = claim(store).await;
    store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
    let again = store.create(with_key("a", "k", "digest")).await.expect("known");
    assert!(matches!(again, Created::Known(job) if job.id == first.id && job.state == State::Succeeded));
    store.delete(first.id).await.expect("deleted");
    assert!(matches!(store.create(with_key("a", "k", "another digest")).await, Ok(Created::New(_))));
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
    let worker = tokio::time::timeout(Duration::from_secs(10), worker);
    let (claimed, job) = tokio::join!(biased; worker, create(store));
    assert_eq!(claimed.expect("in time"), job.id);
}

pub(super) async fn many_at_once_lose_nothing(store: Arc<Store>) {
    let clients: Vec<_> = (0..50)
        .map(|_| {
            let store = Arc::clone(&store);
            tokio::spawn(async move { create(store.as_ref()).await.id })
        })
        .collect();
    let workers: Vec<_> = (0..8)
        .map(|_| {
            let store = Arc::clone(&store);
            tokio::spawn(async move {
                let mut arrivals = store.arrivals();
                let mut claimed = Vec::new();
                loop {
                    arrivals.borrow_and_update();
                    while let Some((ticket, _)) = store.claim(1, LEASE).await.expect("claimable").pop() {
                        let row = vec![What::Iteration("{}".to_owned())];
                        store.append(ticket, row, Progress::default()).await.expect("appended");
                        store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
                        claimed.push(ticket.job);
                    }
                    let patience = Duration::from_millis(200);
                    if tokio::time::timeout(patience, arrivals.changed()).await.is_err() {
                        return claimed;
                    }
                }
            })
        })
        .collect();
    let mut created = Vec::new();
    for client in clients {
        created.push(client.await.expect("no panic"));
    }
    let mut claimed = Vec::new();
    for worker in workers {
        claimed.extend(worker.await.expect("no panic"));
    }
    created.sort();
    claimed.sort();
    assert_eq!(created, claimed);
    for id in created {
        let events = events(store.as_ref(), id, 0, 99).await;
        assert_eq!(events.len(), 4);
    }
}
