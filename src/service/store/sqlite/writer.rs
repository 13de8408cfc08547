//! The one writer: everything that changes a job goes through it, many changes in one transaction.
//!
//! A commit waits for the disk. Whatever was asked for during that wait goes into the next transaction together (group
//! commit), so that commits cost little where there is much to do and nobody waits longer than two of them. Answers are
//! given, and waiters woken, after the commit. When a transaction fails, its commands are tried once more, each in one of
//! its own: one that the database refuses takes no other with it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use async_trait::async_trait;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};
use tokio::sync::{mpsc, oneshot, watch};
use tokio_util::sync::CancellationToken;

use super::super::pulses::Pulses;
use super::super::{JobId, Pulse, Statistics};
use super::{connect, database_error};
use crate::error::{Error, Kind, Result};
use crate::service::faults::{FaultPoint, Faults};

/// Commands in one transaction, at most: a bound on what is lost together and on how long others wait.
const BATCH: usize = 256;

/// Something that changes jobs, as SQL.
#[async_trait]
pub(super) trait Command: Send + Sync + 'static {
    /// What it tells whoever asked for it.
    type Output: Send;

    /// Does it. What may be [refused](Abort::Refused) is refused before anything is written; may be called again after
    /// the transaction failed.
    async fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort>;
}

/// Why a command was not carried out.
#[derive(Debug)]
pub(super) enum Abort {
    /// It is not allowed; nothing was written.
    Refused(Error),
    /// The database failed, and the transaction with it.
    Broken(sqlx::Error),
}

impl From<Error> for Abort {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

impl From<sqlx::Error> for Abort {
    fn from(error: sqlx::Error) -> Self {
        Self::Broken(error)
    }
}

/// The transaction that a command is part of.
pub(super) struct Batch<'c> {
    /// Where to write.
    pub connection: &'c mut SqliteConnection,
    /// Whom to wake afterwards.
    pub effects: Effects,
}

/// What is told once the transaction is committed.
#[derive(Debug, Default)]
pub(super) struct Effects {
    /// Jobs that changed.
    pub pulses: Vec<(JobId, Pulse)>,
    /// Jobs that are gone.
    pub deleted: Vec<JobId>,
    /// Jobs that can be claimed.
    pub arrivals: u64,
    /// Jobs that ended and have a webhook.
    pub endings: u64,
}

/// Those who wait for changes.
#[derive(Debug, Default)]
pub(super) struct Listeners {
    pub pulses: Pulses,
    pub arrivals: watch::Sender<u64>,
    pub endings: watch::Sender<u64>,
}

impl Listeners {
    fn tell(&self, effects: Effects) {
        for (id, pulse) in effects.pulses {
            self.pulses.publish(id, pulse);
        }
        for id in effects.deleted {
            self.pulses.forget(id);
        }
        if effects.arrivals > 0 {
            self.arrivals.send_modify(|count| *count += effects.arrivals);
        }
        if effects.endings > 0 {
            self.endings.send_modify(|count| *count += effects.endings);
        }
    }
}

/// What the writer counts.
#[derive(Debug, Default)]
pub(super) struct Counters {
    commits: AtomicU64,
    commands: AtomicU64,
    failures: AtomicU64,
    busy_us: AtomicU64,
}

impl Counters {
    pub fn read(&self) -> Statistics {
        let get = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Statistics {
            commits: get(&self.commits),
            commands: get(&self.commands),
            failures: get(&self.failures),
            commit_seconds: get(&self.busy_us) as f64 / 1e6,
        }
    }
}

/// The way to the writer.
#[derive(Debug)]
pub(super) struct Writer {
    commands: mpsc::UnboundedSender<Box<dyn Pending>>,
    closing: CancellationToken,
    closed: CancellationToken,
    pub counters: Arc<Counters>,
}

impl Writer {
    /// Starts the writer on an open connection; `options` open another one after a failure.
    pub fn start(
        connection: SqliteConnection,
        options: SqliteConnectOptions,
        listeners: Arc<Listeners>,
        faults: Faults,
    ) -> Self {
        // Unbounded, but whoever sends a command waits for its answer: there are no more than there are askers.
        let (commands, inbox) = mpsc::unbounded_channel();
        let (closing, closed) = (CancellationToken::new(), CancellationToken::new());
        let counters = Arc::<Counters>::default();
        let worker =
            Worker { connection: Some(connection), options, listeners, faults, counters: Arc::clone(&counters) };
        let stop = closing.clone();
        let done = closed.clone().drop_guard();
        tokio::spawn(async move {
            worker.run(inbox, stop).await;
            drop(done);
        });
        Self { commands, closing, closed, counters }
    }

    /// Has a command carried out, and waits until that is on the disk.
    pub async fn carry_out<C: Command>(&self, command: C) -> Result<C::Output> {
        let (reply, answer) = oneshot::channel();
        let asked = Asked { command, outcome: None, reply: Some(reply) };
        let gone = || Error::new(Kind::Unavailable, "the store of jobs is closed");
        self.commands.send(Box::new(asked)).map_err(|_| gone())?;
        answer.await.map_err(|_| gone())?
    }

    /// Carries out what was asked for, and closes the connection.
    pub async fn close(&self) {
        self.closing.cancel();
        self.closed.cancelled().await;
    }
}

/// A command and whoever waits for its answer.
struct Asked<C: Command> {
    command: C,
    outcome: Option<Result<C::Output>>,
    reply: Option<oneshot::Sender<Result<C::Output>>>,
}

#[async_trait]
trait Pending: Send {
    /// Carries the command out, and keeps the answer. An error means that the transaction failed.
    async fn apply(&mut self, batch: &mut Batch<'_>) -> Result<(), sqlx::Error>;

    /// Gives the answer: the one that was kept, or why the transaction failed.
    fn settle(&mut self, failed: Option<Error>);
}

#[async_trait]
impl<C: Command> Pending for Asked<C> {
    async fn apply(&mut self, batch: &mut Batch<'_>) -> Result<(), sqlx::Error> {
        let outcome = match self.command.apply(batch).await {
            Ok(output) => Ok(output),
            Err(Abort::Refused(error)) => Err(error),
            Err(Abort::Broken(error)) => return Err(error),
        };
        self.outcome = Some(outcome);
        Ok(())
    }

    fn settle(&mut self, failed: Option<Error>) {
        let answer = match (failed, self.outcome.take()) {
            (None, Some(outcome)) => outcome,
            (Some(error), _) => Err(error),
            (None, None) => Err(Error::new(Kind::Internal, "a change of a job was forgotten")),
        };
        if let Some(reply) = self.reply.take() {
            // Nobody may be waiting any more.
            let _ = reply.send(answer);
        }
    }
}

struct Worker {
    /// None after a failure, until the next command.
    connection: Option<SqliteConnection>,
    options: SqliteConnectOptions,
    listeners: Arc<Listeners>,
    faults: Faults,
    counters: Arc<Counters>,
}

impl Worker {
    async fn run(mut self, mut inbox: mpsc::UnboundedReceiver<Box<dyn Pending>>, closing: CancellationToken) {
        let mut batch = Vec::new();
        loop {
            let received = tokio::select! {
                biased;
                received = inbox.recv_many(&mut batch, BATCH) => received,
                () = closing.cancelled() => 0,
            };
            if received == 0 {
                break;
            }
            self.carry_out(&mut batch).await;
            batch.clear();
        }
        if let Some(connection) = self.connection.take()
            && let Err(error) = connection.close().await
        {
            tracing::warn!(%error, "the database was not closed in order; it is whole all the same");
        }
    }

    async fn carry_out(&mut self, batch: &mut [Box<dyn Pending>]) {
        let Err(error) = self.commit(batch).await else {
            batch.iter_mut().for_each(|command| command.settle(None));
            return;
        };
        if let [command] = batch {
            command.settle(Some(database_error(error)));
            return;
        }
        tracing::debug!(%error, commands = batch.len(), "a transaction failed; its commands are tried one by one");
        for command in batch {
            let failed = self.commit(std::slice::from_mut(command)).await.err();
            command.settle(failed.map(database_error));
        }
    }

    /// One transaction, and what is told after it.
    async fn commit(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<(), sqlx::Error> {
        let started = Instant::now();
        let outcome = self.transaction(batch).await;
        self.counters.busy_us.fetch_add(started.elapsed().as_micros() as u64, Ordering::Relaxed);
        match outcome {
            Ok(effects) => {
                self.counters.commits.fetch_add(1, Ordering::Relaxed);
                self.counters.commands.fetch_add(batch.len() as u64, Ordering::Relaxed);
                self.listeners.tell(effects);
                Ok(())
            }
            Err(error) => {
                self.counters.failures.fetch_add(1, Ordering::Relaxed);
                // Whatever state it is in: the next transaction gets a new one.
                if let Some(connection) = self.connection.take() {
                    let _ = connection.close().await;
                }
                Err(error)
            }
        }
    }

    async fn transaction(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<Effects, sqlx::Error> {
        let connection = match &mut self.connection {
            Some(connection) => connection,
            none => none.insert(connect(self.options.clone()).await?),
        };
        let mut transaction = connection.begin_with("BEGIN IMMEDIATE").await?;
        let mut all = Batch { connection: &mut transaction, effects: Effects::default() };
        for command in batch {
            command.apply(&mut all).await?;
        }
        let effects = all.effects;
        self.faults.hit(FaultPoint::Commit).map_err(sqlx::Error::Io)?;
        transaction.commit().await?;
        Ok(effects)
    }
}
