//! Which job is claimed next.

use super::*;
use crate::queue::{Share, Shares};

async fn add_for(store: &Store, tenant: &str, priority: i8) -> JobId {
    let spec = Spec { tenant: tenant.to_owned(), priority, ..spec("x") };
    add(store, JobId::random(), spec).await.id
}

async fn claim_with(store: &Store, limit: usize, newcomers: usize, shares: &[(&str, Share)]) -> Vec<(Ticket, Job)> {
    let shares: Shares = shares.iter().map(|(tenant, share)| ((*tenant).to_owned(), *share)).collect();
    let claiming = Claiming { limit, newcomers, lease: LEASE, worker: "w".into(), shares: Arc::new(shares) };
    store.claim_as(claiming).await.expect("claimable").0
}

fn tenants(claimed: &[(Ticket, Job)]) -> Vec<&str> {
    claimed.iter().map(|(_, job)| job.spec.tenant.as_str()).collect()
}

pub(super) async fn a_tenant_with_many_jobs_holds_no_other_tenant_up(store: &Store) {
    for _ in 0..20 {
        add_for(store, "many", 0).await;
    }
    for _ in 0..2 {
        add_for(store, "few", 0).await;
    }
    let first = claim_with(store, 4, 0, &[]).await;
    assert_eq!(tenants(&first), ["many", "few", "many", "few"]);
    // one at a time, too, when nothing else runs
    for (ticket, _) in first {
        store.finish(ticket, End::Cancelled).await.expect("finished");
    }
    add_for(store, "few", 0).await;
    let mut served = Vec::new();
    for _ in 0..2 {
        let claimed = claim_with(store, 1, 0, &[]).await;
        served.push(claimed[0].1.spec.tenant.clone());
        store.finish(claimed[0].0, End::Cancelled).await.expect("finished");
    }
    served.sort();
    assert_eq!(served, ["few", "many"]);
}

pub(super) async fn weights_limits_and_newcomers_are_kept(store: &Store) {
    for _ in 0..12 {
        add_for(store, "a", 0).await;
        add_for(store, "b", 0).await;
    }
    let (two, capped) = (Share { weight: 2, max_running: None }, Share { weight: 9, max_running: Some(1) });
    let claimed = claim_with(store, 9, 0, &[("a", two)]).await;
    assert_eq!(tenants(&claimed).iter().filter(|tenant| **tenant == "a").count(), 6, "twice as many as the other");
    let mut arrivals = store.arrivals();
    add_for(store, "c", 0).await;
    add_for(store, "c", 0).await;
    assert_eq!(tenants(&claim_with(store, 0, 5, &[]).await), ["c"], "the only one without a running job");
    let shares = [("a", capped), ("b", capped), ("c", capped)];
    assert!(claim_with(store, 5, 5, &shares).await.is_empty(), "all are at their limit");
    arrivals.borrow_and_update();
    for (ticket, _) in claimed {
        store.finish(ticket, End::Cancelled).await.expect("finished");
    }
    assert!(arrivals.has_changed().expect("still there"), "an end lets another job start, and says so");
    let mut found = claim_with(store, 9, 0, &shares).await;
    found.sort_by(|(_, one), (_, other)| one.spec.tenant.cmp(&other.spec.tenant));
    assert_eq!(tenants(&found), ["a", "b"]);
}

pub(super) async fn priorities_order_the_jobs_of_a_tenant(store: &Store) {
    let low = add_for(store, "a", -100).await;
    let old = add_for(store, "a", 0).await;
    let new = add_for(store, "a", 0).await;
    let high = add_for(store, "a", 100).await;
    let other = add_for(store, "b", 50).await;
    for (place, id) in (1..).zip([high, old, new, low]) {
        assert_eq!(get(store, id).await.queue_position, Some(place));
    }
    assert_eq!(get(store, other).await.queue_position, Some(1), "jobs of other tenants are not counted");
    let claimed: Vec<_> = claim_with(store, 9, 0, &[]).await.into_iter().map(|(ticket, _)| ticket.job).collect();
    assert_eq!(claimed, [high, other, old, new, low]);
}

pub(super) async fn the_worker_is_known(store: &Store) {
    let id = add_for(store, "a", 0).await;
    assert_eq!(get(store, id).await.worker, None);
    claim_with(store, 1, 0, &[]).await;
    assert_eq!(get(store, id).await.worker.as_deref(), Some("w"));
    assert_eq!(events(store, id, 1, 9).await[0].what, What::Started(1, "w".to_owned()));
}
