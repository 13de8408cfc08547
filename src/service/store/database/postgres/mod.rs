//! PostgreSQL: for several services at once, any of which answers for any job.
//!
//! Every change is a transaction, which returns when the server has it on the disk. Only the clock of the database
//! counts. Work that the database broke off for the sake of other work (a deadlock) is done again. The driver is
//! `tokio-postgres` rather than `sqlx`: it needs no macros that look at a database during the build, and brings half as
//! many crates, TLS by rustls included.
//!
//! # Claims
//!
//! One claim at a time decides, under an advisory lock, so that fairness is exact over all services; a worker with
//! several free places claims for all of them at once. Running and waiting jobs are counted by index: counters in a row
//! for each tenant, locked by every change, would make the changes of a tenant wait for the disk one after the other.
//!
//! A claim takes two round trips: what the rules see of the queue; what they change, and the commit. The lock is not
//! held while a commit waits for the disk: that of a claim is asynchronous, and the worker waits for the disk by a
//! change of its own row, which is sent with the commit.

pub mod address;
mod connections;
mod look;
mod opening;
mod session;

use std::sync::Arc;

use tesserae_mesh::error::Result;
use tokio::runtime::Handle;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use self::connections::{Connections, PATIENCE, cannot_reach};
use self::session::Session;
use super::super::listeners::{Effects, Listeners};
use super::super::url::StoreUrl;
use super::rows::{Abort, Rows};
use crate::ops::blocking::blocking;

/// Times that work is done again that the database broke off, though nothing is wrong with it.
const AGAIN: usize = 5;

/// A database with the tables of the store.
#[derive(Debug)]
pub struct Postgres {
    connections: Connections,
    listeners: Arc<Listeners>,
    stop: CancellationToken,
}

impl Postgres {
    /// Opens the database with at most so many connections, and makes its tables if need be.
    pub async fn open(url: &StoreUrl, most: usize, listeners: Arc<Listeners>) -> Result<Self> {
        let connections = Connections::new(address::parse(url)?, most)?;
        opening::open(&connections).await.map_err(cannot_reach)?;
        let stop = CancellationToken::new();
        let looking = look::look(connections.clone(), Arc::clone(&listeners));
        tokio::spawn(stop.clone().run_until_cancelled_owned(looking));
        Ok(Self { connections, listeners, stop })
    }

    /// Makes a change; returns when it is on the disk, and what follows from it is done.
    pub async fn change<T: Send + 'static>(
        &self,
        command: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let started = Instant::now();
        let outcome = run(&self.connections, true, command).await;
        if outcome.is_ok() {
            self.listeners.committed(1, started.elapsed());
        }
        self.concluded(started, outcome)
    }

    pub async fn read<T: Send + 'static>(
        &self,
        work: impl Fn(&mut dyn Rows) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let started = Instant::now();
        let outcome = run(&self.connections, false, move |rows, _| work(rows)).await;
        self.concluded(started, outcome)
    }

    fn concluded<T>(&self, started: Instant, outcome: Result<(T, Effects)>) -> Result<T> {
        let outcome = outcome.inspect_err(|error| {
            if error.is_of_storage() || error.kind == tesserae_mesh::Kind::Internal {
                self.listeners.failed(started.elapsed());
            }
        });
        let (done, effects) = outcome?;
        self.listeners.publish(effects);
        Ok(done)
    }

    pub fn close(&self) {
        self.stop.cancel();
        self.connections.close();
    }
}

impl Drop for Postgres {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}

/// Does work on a connection, on a thread for blocking work.
async fn run<T: Send + 'static>(
    connections: &Connections,
    is_change: bool,
    mut work: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
) -> Result<(T, Effects)> {
    let deadline = Instant::now() + PATIENCE;
    let mut left = AGAIN;
    loop {
        let client = connections.get(deadline).await.map_err(Abort::into_error)?;
        let (pool, handle) = (connections.clone(), Handle::current());
        let attempt = blocking(move || {
            let mut session = Session::new(&pool, client, handle, deadline, is_change);
            let mut effects = Effects::default();
            let outcome = match work(&mut session, &mut effects) {
                Ok(done) => session.commit().map(|()| (done, effects)),
                Err(Abort::Refused(error)) => session.roll_back().and(Err(Abort::Refused(error))),
                Err(abort) => Err(abort),
            };
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
