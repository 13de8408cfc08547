//! Random histories of the queue: a store picks the jobs that the rules alone pick, and appends the same events.

use proptest::strategy::{Strategy as _, ValueTree as _};
use proptest::test_runner::TestRunner;

use super::super::database::values;
use super::*;
use crate::ops::faults::Faults;
use crate::queue::Change;
use crate::queue::tests::history::{self, New, Step, Stored, play};
use crate::queue::tests::model::{Altered, Model, claiming};

/// Whether all histories, others in each run, are the same in a store as in a model of the rules.
async fn are_as_in<S: Stored>(altered: Altered, mut empty: impl AsyncFnMut() -> S) -> bool {
    let mut runner = TestRunner::default();
    for _ in 0..30 {
        let history: Vec<Step> = history::histories().new_tree(&mut runner).expect("a history").current();
        let mut stored = empty().await;
        let seen = play(&history, &mut stored, false).await;
        let expected = play(&history, &mut Model::new(stored.workers(), altered), false).await;
        if seen != expected {
            println!("{history:#?}\n{seen:#?}\n{expected:#?}");
            return false;
        }
    }
    true
}

/// Workers in the order of their ids, each with its store, and the jobs in the order of their creation with the last
/// claim of each.
struct Workers {
    stores: Vec<Store>,
    jobs: Vec<(JobId, usize, u32)>,
}

impl Stored for Workers {
    fn workers(&self) -> usize {
        self.stores.len()
    }

    async fn create(&mut self, New { tenant, priority, is_small, .. }: New) {
        let spec = Spec { tenant: tenant.to_owned(), priority, is_small, ..spec() };
        let job = add(&self.stores[0], spec).await;
        self.jobs.push((job.id, 0, 0));
    }

    async fn claim(&mut self, worker: usize, limit: usize, newcomers: usize) -> Vec<(usize, u32)> {
        let claiming = claiming(worker, limit, newcomers, 3);
        let claimed = self.stores[worker].claim_as(claiming).await.expect("claimable").0;
        let job = |(ticket, _): (Ticket, Job)| {
            let index = self.jobs.iter().position(|(id, ..)| *id == ticket.job).expect("created here");
            self.jobs[index] = (ticket.job, worker, ticket.attempt);
            (index, ticket.attempt)
        };
        claimed.into_iter().map(job).collect()
    }

    async fn change(&mut self, job: usize, change: Change) -> bool {
        let (id, worker, attempt) = self.jobs[job];
        let store = &self.stores[worker];
        let ticket = |attempt| Ticket { job: id, attempt };
        match change {
            Change::Begin(attempt) => store.begin(ticket(attempt)).await.is_ok(),
            Change::Release { attempt, fault } => store.release(ticket(attempt), fault).await.is_ok(),
            Change::End { attempt, .. } => store.end(ticket(attempt), End::Succeeded(SUMMARY)).await.is_ok(),
            Change::Cancel => store.cancel(id).await.expect("asked").is_some(),
            Change::Retry => match store.retry(id, None).await {
                Ok(_) => true,
                Err(error) if error.kind == Kind::Conflict => false,
                Err(error) => panic!("{error}"),
            },
            Change::LeaseOver => {
                let lost = store.heartbeat(&[ticket(attempt)], Duration::ZERO).await.expect("writable");
                lost.is_empty() && store.reclaim().await == Ok(vec![ticket(attempt)])
            }
            Change::Claim(..) | Change::Heartbeat(..) | Change::Crashed { .. } => unreachable!("{change:?}"),
        }
    }

    async fn crash(&mut self, worker: usize) {
        let (store, next) = (&self.stores[worker], &self.stores[(worker + 1) % self.stores.len()]);
        if !store.is_shared() {
            // as the next process does when it opens the file
            store.recover().await.expect("recovered");
            return;
        }
        let over = store.change("test", |change| {
            let (me, now) = (change.me, change.now()?);
            let sql = "UPDATE jobs SET lease_until = $2 WHERE worker_id = $1 AND state = 'running'";
            change.rows.write(sql, values![me, now])?;
            change.rows.write("UPDATE workers SET alive_until = $2 WHERE id = $1", values![me, now])
        });
        over.await.expect("written");
        next.reclaim().await.expect("reclaimed");
    }

    /// Moves the times in the tables into the past, or back.
    async fn wait(&mut self, seconds: i64) {
        let moved = self.stores[0].change("test", move |change| {
            let jobs = "UPDATE jobs SET not_before = not_before - $1, started_at = started_at - $1, \
                        lease_until = lease_until - $1";
            for sql in [jobs, "UPDATE workers SET alive_until = alive_until - $1"] {
                change.rows.write(sql, values![seconds * 1_000_000])?;
            }
            Ok(())
        });
        moved.await.expect("written");
    }

    async fn events(&mut self, job: usize) -> Vec<JobEvent> {
        let (id, worker, _) = self.jobs[job];
        whats(&self.stores[worker], id).await
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_follows_the_rules_in_every_history() {
    let folder = tempfile::tempdir().expect("a folder");
    let empty = async || {
        let path = folder.path().join(format!("{}.sqlite3", JobId::random()));
        let store = Store::open(&path, true, history::RULES, Faults::default()).await;
        Workers { stores: vec![store.expect("it opens")], jobs: Vec::new() }
    };
    assert!(are_as_in(Altered::Nothing, empty).await);
    assert!(!are_as_in(Altered::Suspects, empty).await, "another rule is noticed");
}

#[cfg(feature = "postgres")]
#[tokio::test(flavor = "multi_thread")]
async fn services_follow_the_rules_in_every_history() {
    let Some(server) = postgres::Server::start() else { return };
    let open = async || postgres::open_all(&server.database(), 3, history::RULES).await;
    let empty = async || Workers { stores: open().await, jobs: Vec::new() };
    assert!(are_as_in(Altered::Nothing, empty).await);
    assert!(!are_as_in(Altered::Suspects, empty).await, "another rule is noticed");
}
