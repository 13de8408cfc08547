//! PostgreSQL: for several services at once, any of which answers for any job.
//!
//! Every change is a transaction, which returns when the server has it on the disk. Only the clock of the database
//! counts. Work that the database broke off for the sake of other work (a deadlock) is done again. The driver is
//! `tokio-postgres`, which sends statements together: to create, claim and end a job are 4, 4 and 2 round trips, with
//! sqlx or diesel 8, 12 and 10 (`benches/results/2026-11-30-two-cores/crates.md`).
//!
//! One claim at a time decides, under an advisory lock, so that fairness is exact over all services; a worker with
//! several free places claims for all of them at once. Running and waiting jobs are counted by index: counters in a row
//! for each tenant, locked by every change, would make the changes of a tenant wait for the disk one after the other.
//!
//! The lock is not held while a commit waits for the disk: that of a claim is asynchronous, and the worker waits for
//! the disk by a change of its own row after it. Both commits are in one log, so the later one is on the disk only if
//! that of the claim is.

pub mod address;
mod connections;
mod opening;
mod session;

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use tesserae_mesh::error::{Kind, Result};
use tokio::time::{Instant, sleep};
use tokio_util::task::AbortOnDropHandle;

use self::connections::{Connections, PATIENCE, cannot_reach};
use self::session::Session;
use super::super::job::JobId;
use super::super::listeners::{Effects, Listeners};
use super::super::terms::Pulse;
use super::{Abort, MIGRATIONS, Rows, StoreUrl, values};
use crate::ops::blocking;

/// A database with the tables of the store.
pub struct Postgres {
    connections: Connections,
    listeners: Arc<Listeners>,
    looking: AbortOnDropHandle<()>,
}

/// Brings the tables to the version of other migrations.
#[cfg(test)]
pub async fn migrate(url: &StoreUrl, migrations: &'static [&'static str]) -> Result<()> {
    opening::open(Connections::new(address::parse(url)?, 1)?, migrations).await
}

impl Postgres {
    /// Opens the database with at most so many connections, and makes its tables if need be.
    pub async fn open(url: &StoreUrl, most: usize, listeners: Arc<Listeners>) -> Result<Self> {
        let connections = Connections::new(address::parse(url)?, most)?;
        opening::open(connections.clone(), &MIGRATIONS).await.map_err(cannot_reach)?;
        let looking = AbortOnDropHandle::new(tokio::spawn(look(connections.clone(), Arc::clone(&listeners))));
        Ok(Self { connections, listeners, looking })
    }

    /// Makes a change, or reads; returns when a change is on the disk, and what follows from it is done.
    pub async fn run<T: Send + 'static>(
        &self,
        is_change: bool,
        work: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let started = Instant::now();
        let outcome = run(&self.connections, is_change, work).await;
        match &outcome {
            Ok(_) if is_change => self.listeners.count(Some(1), started.elapsed()),
            Err(error) if error.is_of_storage() || error.kind == Kind::Internal => {
                self.listeners.count(None, started.elapsed());
            }
            _ => {}
        }
        let (done, effects) = outcome?;
        self.listeners.publish(effects);
        Ok(done)
    }

    pub fn close(&self) {
        self.looking.abort();
        self.connections.close();
    }
}

/// Does work on a connection, on a thread for blocking work.
async fn run<T: Send + 'static>(
    connections: &Connections,
    is_change: bool,
    mut work: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
) -> Result<(T, Effects)> {
    let deadline = Instant::now() + PATIENCE;
    // times that work is done again that the database broke off, though nothing is wrong with it
    let mut left = 5;
    loop {
        let permit = connections.permit(deadline).await?;
        let pool = connections.clone();
        let attempt = blocking(move || {
            let outcome = pool.get(deadline).and_then(|connection| {
                let mut session = Session::new(&pool, connection, deadline, is_change);
                let mut effects = Effects::default();
                match work(&mut session, &mut effects) {
                    Ok(done) => session.end(true).map(|()| (done, effects)),
                    Err(Abort::Refused(error)) => session.end(false).and(Err(Abort::Refused(error))),
                    Err(abort) => Err(abort),
                }
            });
            drop(permit);
            (work, outcome)
        });
        let outcome;
        (work, outcome) = attempt.await?;
        match outcome {
            Err(Abort::Again(_)) if left > 0 => left -= 1,
            outcome => return outcome.map_err(Abort::into_error),
        }
    }
}

/// Looks at the queue for workers, and at the jobs that tasks wait for: so services learn what others did.
async fn look(connections: Connections, listeners: Arc<Listeners>) {
    let mut seen = 0;
    for turn in 0u64.. {
        sleep(Duration::from_millis(200)).await;
        let started = Instant::now();
        let watched = listeners.pulses.waited_for();
        let ids = watched.iter().map(JobId::to_string).collect::<Vec<_>>().join(",");
        let found = run(&connections, false, move |rows, _| {
            let sql = "SELECT coalesce((SELECT max(number) FROM jobs), 0) AS newest, \
                EXISTS (SELECT FROM jobs WHERE state = 'queued') AS waits";
            let queue = rows.one(sql, Vec::new())?;
            let sql = "SELECT id, last_seq, cancel_requested, state FROM jobs \
                WHERE id = ANY (string_to_array($1, ','))";
            let watched = rows.query(sql, values![&*ids])?;
            Ok((queue.get::<i64>("newest")?, queue.get::<bool>("waits")?, watched))
        });
        let Ok(((newest, waits, rows), _)) = found.await else {
            listeners.count(None, started.elapsed());
            continue;
        };
        // once a second, workers look at a queue without new jobs, and the deliveries of webhooks for ends
        let is_seldom = turn.is_multiple_of(5);
        if waits && (is_seldom || newest > seen) {
            listeners.arrivals.send_replace(());
        }
        seen = newest;
        if is_seldom {
            listeners.endings.send_replace(());
        }
        let mut deleted: HashSet<JobId> = watched.into_iter().collect();
        for row in &rows {
            if let (Ok(id), Ok(pulse)) = (row.get("id"), Pulse::of(row)) {
                deleted.remove(&id);
                listeners.pulses.publish(id, Some(pulse));
            }
        }
        deleted.into_iter().for_each(|id| listeners.pulses.publish(id, None));
    }
}
