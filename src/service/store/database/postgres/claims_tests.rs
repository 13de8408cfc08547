//! Claims by many services at once, and what they cost.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::super::super::conformance::claims;
use super::super::super::tests::RULES;
use super::super::super::{End, JobStore, Queue as _, Rules};
use super::server::Server;
use super::{LEASE, PostgresStore, create};

/// `CLAIM_JOBS=5000`, with `-- --nocapture`, gives the figures in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn claimers_of_many_services_take_each_job_once() {
    let Some(server) = Server::start() else { return };
    let jobs = claims::jobs();
    for limit in [1, 8] {
        let url = server.database();
        let mut services: Vec<Arc<dyn JobStore>> = Vec::new();
        for _ in 0..16 {
            let rules = Rules { max_queued: jobs, ..RULES };
            services.push(Arc::new(PostgresStore::open(&url, 2, rules).await.expect("it opens")));
        }
        claims::claim_all(&services, limit, jobs).await;
    }
}

/// Workers on devices that take 50 ms for a job: four do nearly four times as much as one, as none waits for another.
/// Beside all other tests they do more than twice as much. `WORKER_JOBS=100`, with `-- --nocapture`, gives the figure
/// in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn workers_add_up() {
    let Some(server) = Server::start() else { return };
    let (jobs, least) = match std::env::var("WORKER_JOBS") {
        Ok(jobs) => (jobs.parse().expect("a number"), 3.8),
        Err(_) => (16, 2.0),
    };
    let rules = Rules { max_queued: 4 * jobs, ..RULES };
    let mut rates = Vec::new();
    for count in [1, 4, 4, 1] {
        let url = server.database();
        let mut stores = Vec::new();
        for _ in 0..count {
            stores.push(PostgresStore::open(&url, 2, rules).await.expect("it opens"));
        }
        for _ in 0..jobs * count {
            create(&stores[0]).await;
        }
        let started = Instant::now();
        let workers = stores.into_iter().map(|store| {
            tokio::spawn(async move {
                while let Some((ticket, _)) = store.claim(1, LEASE).await.expect("claimable").pop() {
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    store.finish(ticket, End::Cancelled).await.expect("ended");
                }
            })
        });
        futures_util::future::try_join_all(workers).await.expect("no panic");
        let rate = (jobs * count) as f64 / started.elapsed().as_secs_f64();
        println!("{count} workers on devices that take 50 ms: {rate:.1} jobs a second");
        rates.push(rate);
    }
    let gain = (rates[1] + rates[2]) / (rates[0] + rates[3]);
    assert!(gain >= least, "four workers do {gain:.2} times as much as one");
}
