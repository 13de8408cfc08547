//! Claims of many jobs at once, and what they cost.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::super::tests::new_job;
use super::super::{Claiming, End, Spec, Store};
use super::{LEASE, events};

/// How many jobs are claimed: `CLAIM_JOBS` says it for the figures in `docs/farm.md`.
pub fn jobs() -> usize {
    std::env::var("CLAIM_JOBS").map_or(1200, |jobs| jobs.parse().expect("a number"))
}

/// Claims empty jobs by one claimer a store, each of which ends those that it claimed before it claims again. All
/// stores have the same jobs.
pub async fn claim_all(stores: &[Arc<Store>], limit: usize, jobs: usize) {
    let creators = (0..8).map(|creator| {
        let store = Arc::clone(&stores[creator % stores.len()]);
        tokio::spawn(async move {
            for number in 0..jobs / 8 {
                let mut job = new_job();
                job.spec = Spec { tenant: format!("tenant {}", (creator + number) % 5), ..job.spec };
                store.create(job).await.expect("created");
            }
        })
    });
    futures_util::future::try_join_all(creators).await.expect("no panic");
    let claimers = (0..stores.len()).map(|number| {
        let store = Arc::clone(&stores[number]);
        async move {
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
                    store.finish(ticket, End::Cancelled).await.expect("ended");
                }
            }
        }
    });
    let started = Instant::now();
    let claimers: Vec<_> = claimers.map(tokio::spawn).collect();
    let (mut claimed, mut claiming) = (Vec::new(), Duration::ZERO);
    for claimer in claimers {
        let (jobs, time) = claimer.await.expect("no panic");
        claimed.extend(jobs);
        claiming += time;
    }
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
