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
    let referred = Some(Referred { url: None, tag: None, parts: None });
    add(store, taken, Spec { referred, ..spec("x") }).await;
    assert_eq!((store.reservation(taken).await, waiting().await), (Ok(None), 3));
    for _ in 0..2 {
        store.unreserve(given_up).await.expect("given up");
    }
    assert_eq!((store.reservation(given_up).await, waiting().await), (Ok(None), 2));
    store.reserve(over, new(&tenant, "x"), Duration::ZERO).await.expect("reserved");
    assert_eq!(store.reservation(over).await, Ok(Some(Reservation { is_over: true, ..new(&tenant, "x") })));
    assert_eq!(waiting().await, 2);
    store.reserve(JobId::random(), new("another", "x"), Duration::ZERO).await.expect("reserved");
    assert!(store.reservation(over).await.expect("readable").is_some(), "another tenant's");
    store.reserve(JobId::random(), new(&tenant, "x"), Duration::ZERO).await.expect("reserved");
    assert_eq!(store.reservation(over).await, Ok(None), "it was over for as long again");
    assert!(store.reservation(another).await.expect("readable").is_some());
}
