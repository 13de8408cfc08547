mod claims;
mod server;

use std::time::Duration;

use async_trait::async_trait;
use parking_lot::Mutex;

use self::server::Server;
use super::super::conformance::{self, Subject};
use super::super::tests::{RULES, new_job};
use super::super::{
    Created, End, Events as _, JobId, JobStore, Maintenance as _, Notices as _, Queue as _, Release, Rules, State,
    StoreUrl, Summary, Ticket, What,
};
use super::replica::PostgresStore;
use crate::error::{Error, Kind};

const LEASE: Duration = Duration::from_secs(3600);

/// A service on a database.
async fn open(url: &StoreUrl, rules: Rules) -> PostgresStore {
    PostgresStore::open(url, 12, rules).await.expect("it opens")
}

/// Stores in databases of their own, on one server.
struct OnServer {
    server: Server,
    last: Mutex<Option<StoreUrl>>,
}

#[async_trait]
impl Subject for OnServer {
    async fn empty(&self, rules: Rules) -> Box<dyn JobStore> {
        let url = self.server.database();
        *self.last.lock() = Some(url.clone());
        Box::new(open(&url, rules).await)
    }

    /// Another service on the same database, when the leases of the first are over.
    async fn after_crash(&self, rules: Rules) -> Option<Box<dyn JobStore>> {
        let url = self.last.lock().clone().expect("a store was made");
        let store = open(&url, rules).await;
        expire(&store).await;
        store.reclaim().await.expect("reclaimed");
        Some(Box::new(store))
    }
}

/// Ends the leases of all workers.
async fn expire(store: &PostgresStore) {
    let expired = store.connections.run(|client| async move {
        client.batch_execute("UPDATE jobs SET lease_until = clock_timestamp() WHERE state = 'running'").await?;
        Ok(client.batch_execute("UPDATE workers SET alive_until = clock_timestamp()").await?)
    });
    expired.await.expect("expired");
}

#[tokio::test(flavor = "multi_thread")]
async fn conforms() {
    let Some(server) = Server::start() else { return };
    conformance::run(&OnServer { server, last: Mutex::default() }).await;
}

async fn create(store: &PostgresStore) -> JobId {
    match store.create(new_job()).await.expect("created") {
        Created::New(job) | Created::Known(job) => job.id,
    }
}

async fn claim(store: &PostgresStore) -> Ticket {
    store.claim(1, LEASE).await.expect("claimable").pop().expect("a job").0
}

#[tokio::test(flavor = "multi_thread")]
async fn services_share_jobs_changes_and_cancellations() {
    let Some(server) = Server::start() else { return };
    let url = server.database();
    let (one, other) = (open(&url, RULES).await, open(&url, RULES).await);
    assert!(one.is_shared() && one.is_durable());
    // notified long before the look that follows anyway would be due
    let mut arrivals = other.arrivals();
    arrivals.borrow_and_update();
    let job = create(&one).await;
    tokio::time::timeout(Duration::from_secs(30), arrivals.changed()).await.expect("in time").expect("still there");
    let ticket = claim(&other).await;
    assert_eq!(ticket.job, job);
    assert!(one.claim(9, LEASE).await.expect("claimable").is_empty(), "it is claimed once");
    let mut pulses = one.watch(job).await.expect("watchable").expect("a job");
    let mut asked = other.watch(job).await.expect("watchable").expect("a job");
    one.cancel(job).await.expect("asked");
    let patience = Duration::from_secs(30);
    let cancelled = asked.wait_for(|pulse| pulse.cancel_requested);
    tokio::time::timeout(patience, cancelled).await.expect("in time").expect("told");
    assert_eq!(
        one.finish(Ticket { attempt: 2, ..ticket }, End::Cancelled).await.expect_err("other").kind,
        Kind::Conflict
    );
    other.append(ticket, vec![What::Iteration("{}".into())], Default::default()).await.expect("appended");
    other.finish(ticket, End::Cancelled).await.expect("finished");
    let ended = pulses.wait_for(|pulse| pulse.ended);
    tokio::time::timeout(patience, ended).await.expect("in time").expect("told");
    assert_eq!(one.events(job, 0, 99).await.expect("readable").expect("a job").len(), 4);
    other.delete(job).await.expect("deleted");
    let gone = async { while pulses.changed().await.is_ok() {} };
    tokio::time::timeout(patience, gone).await.expect("a deletion is noticed");
    for store in [&one, &other] {
        store.close().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_happens_to_running_jobs_because_a_service_starts() {
    let Some(server) = Server::start() else { return };
    let url = server.database();
    let first = open(&url, RULES).await;
    create(&first).await;
    let ticket = claim(&first).await;
    first.begin(ticket).await.expect("begun");
    let second = open(&url, RULES).await;
    assert_eq!(second.reclaim().await, Ok(vec![]));
    assert_eq!(second.get(ticket.job).await.expect("readable").expect("a job").state, State::Running);
    // the zombie: its lease is over, another one has the job, and what it writes is refused
    expire(&second).await;
    assert_eq!(second.reclaim().await, Ok(vec![ticket]));
    let again = claim(&second).await;
    assert_eq!(again.attempt, 2);
    let summary = Summary { faces: 1, clusters: 1, labels_sha256: None, is_small: false, blobs: Default::default() };
    for refused in [
        first.finish(ticket, End::Succeeded(summary.clone())).await,
        first.append(ticket, vec![What::Iteration("{}".into())], Default::default()).await,
        first.release(ticket, Release::Free).await.map(drop),
        first.begin(ticket).await,
    ] {
        assert_eq!(refused.expect_err("it is another's").kind, Kind::Conflict);
    }
    second.finish(again, End::Succeeded(summary)).await.expect("finished");
}

#[tokio::test(flavor = "multi_thread")]
async fn changes_whose_answer_was_lost_are_not_made_twice() {
    let Some(server) = Server::start() else { return };
    let store = open(&server.database(), RULES).await;
    create(&store).await;
    let ticket = claim(&store).await;
    let rows = || vec![What::Iteration("1".into()), What::Iteration("2".into())];
    store.append(ticket, rows(), Default::default()).await.expect("appended");
    // as if the answer had not come
    *store.held.lock().get_mut(&ticket).expect("held") -= 2;
    store.append(ticket, rows(), Default::default()).await.expect("known");
    assert_eq!(store.events(ticket.job, 2, 99).await.expect("readable").expect("a job").len(), 2);
    store.finish(ticket, End::Cancelled).await.expect("ended");
    store.held.lock().insert(ticket, 5);
    store.finish(ticket, End::Cancelled).await.expect("the same end again");
    store.held.lock().insert(ticket, 5);
    let other = store.finish(ticket, End::Failed(Error::new(Kind::InvalidMesh, "x"))).await;
    assert_eq!(other.expect_err("another end").kind, Kind::Conflict);
    // a claim that was made, and not heard of
    let unheard = create(&store).await;
    claim(&store).await;
    store.held.lock().clear();
    *store.is_unsure.lock().await = true;
    let ticket = claim(&store).await;
    assert_eq!(ticket, Ticket { job: unheard, attempt: 2 });
    let job = store.get(unheard).await.expect("readable").expect("a job");
    assert_eq!(job.state, State::Running);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_stops_is_unavailable_and_loses_nothing() {
    let Some(server) = Server::start() else { return };
    let store = open(&server.database(), RULES).await;
    let kept = create(&store).await;
    let ticket = claim(&store).await;
    let pulses = store.watch(kept).await.expect("watchable").expect("a job");
    server.down();
    for failed in [
        store.create(new_job()).await.map(drop),
        store.get(kept).await.map(drop),
        store.probe().await,
        store.heartbeat(&[ticket], LEASE).await.map(drop),
    ] {
        let error = failed.expect_err("the server is down");
        assert_eq!(error.kind, Kind::Unavailable, "{error}");
    }
    assert!(store.statistics().failures >= 4);
    server.up();
    store.probe().await.expect("it works again");
    assert_eq!(store.reclaim().await, Ok(vec![]), "no lease is over");
    store.finish(ticket, End::Cancelled).await.expect("finished");
    assert!(pulses.borrow().ended);
}

#[tokio::test(flavor = "multi_thread")]
async fn one_service_cleans_up_and_each_notice_is_delivered_by_one() {
    let Some(server) = Server::start() else { return };
    let url = server.database();
    let (one, other) = (open(&url, RULES).await, open(&url, RULES).await);
    assert_eq!((one.may_clean_up().await, other.may_clean_up().await), (Ok(true), Ok(false)));
    assert_eq!(one.may_clean_up().await, Ok(true));
    let mut job = new_job();
    job.spec.webhook = Some("https://a.example/".to_owned());
    let id = job.id;
    one.create(job).await.expect("created");
    one.cancel(id).await.expect("cancelled");
    assert_eq!(other.untold().await, Ok(vec![id]));
    assert_eq!(one.untold().await, Ok(vec![]), "the other one delivers it");
    other.close().await;
    assert_eq!(one.untold().await, Ok(vec![id]));
    one.close().await;
    let third = open(&url, RULES).await;
    assert_eq!(third.may_clean_up().await, Ok(true), "a service that stops leaves its duties");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_migration_of_the_next_release_disturbs_no_service_that_works() {
    let Some(server) = Server::start() else { return };
    let url = server.database();
    let (old, other) = (open(&url, RULES).await, open(&url, RULES).await);
    // every statement is prepared on its connections, and every plan of the claim is made
    let work = async |store: &PostgresStore| {
        let id = create(store).await;
        store.list(&Default::default()).await.expect("listed");
        let ticket = claim(store).await;
        assert_eq!(ticket.job, id);
        store.begin(ticket).await.expect("begun");
        store.append(ticket, vec![What::Iteration("{}".into())], Default::default()).await.expect("appended");
        store.release(ticket, Release::Free).await.expect("released");
        let ticket = claim(store).await;
        store.finish(ticket, End::Cancelled).await.expect("ended");
        assert_eq!(store.get(id).await.expect("readable").expect("a job").state, State::Cancelled);
        assert_eq!(store.events(id, 0, 99).await.expect("readable").expect("a job").len(), 6);
    };
    work(&old).await;
    work(&other).await;
    let migrated = other.connections.run(|client| async move {
        let sql = "ALTER TABLE jobs ADD COLUMN later text NOT NULL DEFAULT 'x', ADD COLUMN latest json; \
                   ALTER TABLE workers ADD COLUMN later integer; UPDATE schema_version SET version = 99, needs = 1";
        Ok(client.batch_execute(sql).await?)
    });
    migrated.await.expect("migrated");
    work(&old).await;
    work(&other).await;
    let new = open(&url, RULES).await;
    work(&new).await;
    assert_eq!(old.statistics().failures, 0, "no answer was lost");
}

#[tokio::test(flavor = "multi_thread")]
async fn tables_of_a_later_release_are_refused_and_those_that_it_left_usable_are_not() {
    let Some(server) = Server::start() else { return };
    let url = server.database();
    let store = open(&url, RULES).await;
    let set = async |version: i32, needs: i32| {
        let changed = store.connections.run(|client| async move {
            let sql = "UPDATE schema_version SET version = $1, needs = $2";
            Ok(client.execute(sql, &[&version, &needs]).await?)
        });
        assert_eq!(changed.await, Ok(1));
    };
    set(99, 1).await;
    open(&url, RULES).await.close().await;
    set(99, 98).await;
    let error = PostgresStore::open(&url, 2, RULES).await.expect_err("too new");
    assert!(error.message.contains("version 99"), "{error}");
}
