//! Uploads by URL that no job is made of yet.

use super::super::Referred;
use super::*;

pub(super) async fn what_is_reserved_counts_until_it_is_a_job_or_over(store: &dyn JobStore) {
    let tenant = spec("x").tenant;
    let waiting = async || store.waiting_of(&tenant).await.expect("counted");
    let new = |tenant: &str, name: &str| Reservation {
        tenant: tenant.to_owned(),
        bytes: 1 << 40,
        file_name: Some(name.to_owned()),
        is_over: false,
    };
    let [taken, given_up, over, another] = [(); 4].map(|()| JobId::random());
    // a name may have any characters
    let names = ["\0 ü/β \"\u{202e}.obj", "x"];
    store.reserve(taken, new(&tenant, names[0]), LEASE).await.expect("reserved");
    store.reserve(given_up, new(&tenant, names[1]), LEASE).await.expect("reserved");
    store.reserve(another, new("another", "x"), LEASE).await.expect("reserved");
    assert_eq!(store.reservation(taken).await, Ok(Some(new(&tenant, names[0]))));
    create(store).await;
    assert_eq!(waiting().await, 3);
    add(store, taken, by_url()).await;
    assert_eq!((store.reservation(taken).await, waiting().await), (Ok(None), 3));
    assert_eq!((store.unreserve(given_up).await, store.unreserve(given_up).await), (Ok(true), Ok(false)));
    assert_eq!((store.reservation(given_up).await, waiting().await), (Ok(None), 2));
    let late = store.create(job_of(given_up)).await;
    assert_eq!(late.expect_err("no job without a reservation").kind, Kind::NotFound);
    assert_eq!((store.get(given_up).await, waiting().await), (Ok(None), 2));
    store.reserve(over, new(&tenant, "x"), Duration::ZERO).await.expect("reserved");
    assert_eq!(store.reservation(over).await, Ok(Some(Reservation { is_over: true, ..new(&tenant, "x") })));
    assert_eq!(waiting().await, 2);
    store.reserve(JobId::random(), new("another", "x"), Duration::ZERO).await.expect("reserved");
    assert_eq!(store.reservation(over).await, Ok(None), "it was over for as long again");
    assert!(store.reservation(another).await.expect("readable").is_some());
}

/// The spec of a job of an upload by URL.
fn by_url() -> Spec {
    Spec { referred: Some(Referred { url: None, tag: None, parts: None }), ..spec("x") }
}

fn job_of(upload: JobId) -> NewJob {
    NewJob { id: upload, spec: by_url(), idempotency: None, upload: Vec::new() }
}

pub(super) async fn a_reservation_that_is_taken_back_becomes_no_job(store: &dyn JobStore) {
    let tenant = by_url().tenant;
    let reservation = Reservation { tenant: tenant.clone(), bytes: 1, file_name: None, is_over: false };
    let mut jobs = 0;
    for round in 0..20 {
        let id = JobId::random();
        store.reserve(id, reservation.clone(), LEASE).await.expect("reserved");
        let create = store.create(job_of(id));
        let take_back = async {
            let was_there = store.unreserve(id).await.expect("taken back");
            (was_there, store.get(id).await.expect("readable").is_some())
        };
        let (created, (was_taken_back, was_job)) = match round % 2 {
            0 => futures_util::join!(create, take_back),
            _ => {
                let (taken_back, created) = futures_util::join!(take_back, create);
                (created, taken_back)
            }
        };
        assert_eq!(created.is_ok(), was_job, "what is no job when it is taken back becomes none");
        assert_ne!(created.is_ok(), was_taken_back);
        match created {
            Ok(_) => jobs += 1,
            Err(error) => assert_eq!(error.kind, Kind::NotFound, "{error}"),
        }
        assert_eq!(store.reservation(id).await, Ok(None));
        assert_eq!(store.waiting_of(&tenant).await, Ok(jobs));
    }
}
