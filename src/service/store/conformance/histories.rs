//! Random histories of the queue: a store picks the jobs that the rules alone pick, and appends the same events.

use proptest::strategy::{Strategy as _, ValueTree as _};
use proptest::test_runner::TestRunner;
use tempfile::TempDir;

use super::super::database::rows::values;
use super::sqlite::NAME;
use super::*;
use crate::ops::faults::Faults;
use crate::queue::tests::history::{self, New, Step, Stored, play};
use crate::queue::tests::model::{Altered, Model, claiming};
use crate::queue::{self, Change};

/// How many histories a store goes through.
const HISTORIES: usize = 30;

/// Whether all histories are the same in a store as in a model of the rules.
async fn are_as_in<S: Stored>(altered: Altered, mut empty: impl AsyncFnMut() -> S) -> bool {
    let mut runner = TestRunner::deterministic();
    for _ in 0..HISTORIES {
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

/// A store, and how one of its workers crashes.
trait Crashes {
    fn stores(&self) -> &[Store];
    async fn crash(&mut self, worker: usize);
}

/// Workers, and the jobs in the order of their creation with the last claim of each.
struct Workers<C> {
    subject: C,
    jobs: Vec<(JobId, usize, u32)>,
}

impl<C: Crashes> Workers<C> {
    fn store(&self, job: usize) -> &Store {
        &self.subject.stores()[self.jobs[job].1]
    }
}

impl<C: Crashes> Stored for Workers<C> {
    fn workers(&self) -> usize {
        self.subject.stores().len()
    }

    async fn create(&mut self, New { tenant, priority, is_small, .. }: New) {
        let spec = Spec { tenant: tenant.to_owned(), priority, is_small, ..spec("x") };
        let job = add(&self.subject.stores()[0], JobId::random(), spec).await;
        self.jobs.push((job.id, 0, 0));
    }

    async fn claim(&mut self, worker: usize, limit: usize, newcomers: usize) -> Vec<(usize, u32)> {
        let claiming = claiming(worker, limit, newcomers, 3);
        let claimed = self.subject.stores()[worker].claim_as(claiming).await.expect("claimable").0;
        let job = |(ticket, _): (Ticket, Job)| {
            let index = self.jobs.iter().position(|(id, ..)| *id == ticket.job).expect("created here");
            self.jobs[index] = (ticket.job, worker, ticket.attempt);
            (index, ticket.attempt)
        };
        claimed.into_iter().map(job).collect()
    }

    async fn change(&mut self, job: usize, change: Change) -> bool {
        let ((id, _, attempt), store) = (self.jobs[job], self.store(job));
        let ticket = |attempt| Ticket { job: id, attempt };
        match change {
            Change::Begin { attempt } => store.begin(ticket(attempt)).await.is_ok(),
            Change::Release { attempt, release } => store.release(ticket(attempt), release).await.is_ok(),
            Change::End { attempt, .. } => store.finish(ticket(attempt), End::Succeeded(SUMMARY)).await.is_ok(),
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
            Change::Claim { .. } | Change::Heartbeat { .. } | Change::Crashed { .. } => unreachable!("{change:?}"),
        }
    }

    async fn crash(&mut self, worker: usize) {
        self.subject.crash(worker).await;
    }

    /// Moves the times in the tables into the past, or back.
    async fn wait(&mut self, seconds: i64) {
        let moved = self.subject.stores()[0].change("test", move |change| {
            let jobs = "UPDATE jobs SET not_before = not_before - $1, started_at = started_at - $1, \
                        lease_until = lease_until - $1";
            for sql in [jobs, "UPDATE workers SET alive_until = alive_until - $1"] {
                change.rows.write(sql, values![seconds * 1_000_000])?;
            }
            Ok(())
        });
        moved.await.expect("written");
    }

    async fn events(&mut self, job: usize) -> Vec<queue::Event> {
        let events = events(self.store(job), self.jobs[job].0, 0, usize::MAX).await;
        assert!(events.iter().map(|event| event.seq).eq(1..=events.len() as u64), "{events:?}");
        let event = |event: Event| match event.what {
            What::State(State::Queued) => queue::Event::Queued,
            What::Started(attempt, worker) => queue::Event::Started(attempt, worker.into()),
            What::End(state, problem) => queue::Event::End(state, problem),
            other => panic!("{other:?}"),
        };
        events.into_iter().map(event).collect()
    }
}

/// The only worker of a file.
struct OneFile([Store; 1], #[expect(dead_code, reason = "it goes with the store")] TempDir);

impl Crashes for OneFile {
    fn stores(&self) -> &[Store] {
        &self.0
    }

    /// Does what the next process does when it opens the file.
    async fn crash(&mut self, _: usize) {
        self.0[0].recover().await.expect("recovered");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_follows_the_rules_in_every_history() {
    let empty = async || {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::temporary(&folder.path().join(NAME), history::RULES, Faults::default()).await;
        Workers { subject: OneFile([store.expect("it opens")], folder), jobs: vec![] }
    };
    assert!(are_as_in(Altered::Nothing, empty).await);
    assert!(!are_as_in(Altered::Weights, empty).await, "other rules are noticed");
}

#[cfg(feature = "postgres")]
mod shared {
    use super::super::postgres::open;
    use super::super::server::Server;
    use super::*;

    struct Services([Store; 3]);

    impl Crashes for Services {
        fn stores(&self) -> &[Store] {
            &self.0
        }

        /// Its leases are over.
        async fn crash(&mut self, worker: usize) {
            let over = self.0[worker].change("test", |change| {
                let (me, now) = (change.me, change.now()?);
                let sql = "UPDATE jobs SET lease_until = $2 WHERE worker_id = $1 AND state = 'running'";
                change.rows.write(sql, values![me, now])?;
                change.rows.write("UPDATE workers SET alive_until = $2 WHERE id = $1", values![me, now])
            });
            over.await.expect("written");
            self.0[(worker + 1) % 3].reclaim().await.expect("reclaimed");
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn services_follow_the_rules_in_every_history() {
        let Some(server) = Server::start() else { return };
        let empty = async || {
            let (url, rules) = (server.database(), history::RULES);
            let subject = Services([open(&url, rules).await, open(&url, rules).await, open(&url, rules).await]);
            Workers { subject, jobs: vec![] }
        };
        assert!(are_as_in(Altered::Nothing, empty).await);
        assert!(!are_as_in(Altered::Weights, empty).await, "other rules are noticed");
    }
}
