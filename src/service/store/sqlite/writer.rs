//! The one writer: everything that changes a job goes through it, many changes in one transaction, on a thread of its own.
//!
//! A commit waits for the disk. Whatever was asked for during that wait goes into the next transaction together (group
//! commit), so that commits cost little where there is much to do and nobody waits longer than two of them. Answers are
//! given, and waiters woken, after the commit. When a transaction fails, its commands are tried once more, each in one of
//! its own: one that the database refuses, or that panics, takes no other with it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Instant;
use std::{io, iter, slice, thread};

use rusqlite::{Connection, TransactionBehavior};
use tokio::sync::{oneshot, watch};
use tokio_util::sync::CancellationToken;

use super::super::pulses::Pulses;
use super::super::{JobId, Pulse, Statistics};
use super::check::Damage;
use super::claim_memory::Claims;
use super::connections::{self, Abort, closed};
use crate::error::{Error, Kind, Result};
use crate::service::faults::{FaultPoint, Faults};

/// Commands in one transaction, at most: a bound on what is lost together and on how long others wait.
const BATCH: usize = 256;

/// Something that changes jobs, as SQL.
pub(super) trait Command: Send + 'static {
    /// What it tells whoever asked for it.
    type Output: Send;

    /// Does it. What may be [refused](Abort::Refused) is refused before anything is written; may be called again after
    /// the transaction failed.
    fn apply(&self, batch: &mut Batch<'_>) -> Result<Self::Output, Abort>;
}

/// The transaction that a command is part of.
pub(super) struct Batch<'c> {
    /// Where to write.
    pub connection: &'c Connection,
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
    /// Jobs that ended: others may be claimed in their stead.
    pub ends: u64,
    /// Jobs that ended and have a webhook.
    pub endings: u64,
    /// As in [`Statistics`].
    pub attempts_failed: u64,
    /// As in [`Statistics`].
    pub given_up: u64,
}

/// Those who wait for changes.
#[derive(Debug, Default)]
pub(super) struct Listeners {
    pub pulses: Pulses,
    pub arrivals: watch::Sender<u64>,
    pub endings: watch::Sender<u64>,
    pub claims: Claims,
}

impl Listeners {
    fn tell(&self, effects: Effects) {
        for (id, pulse) in effects.pulses {
            self.pulses.publish(id, pulse);
        }
        for id in effects.deleted {
            self.pulses.forget(id);
        }
        if effects.arrivals > 0 || (effects.ends > 0 && self.claims.has_held_back()) {
            self.arrivals.send_modify(|count| *count += effects.arrivals.max(1));
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
    attempts_failed: AtomicU64,
    given_up: AtomicU64,
}

impl Counters {
    pub fn read(&self) -> Statistics {
        let get = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Statistics {
            commits: get(&self.commits),
            commands: get(&self.commands),
            failures: get(&self.failures),
            commit_seconds: get(&self.busy_us) as f64 / 1e6,
            attempts_failed: get(&self.attempts_failed),
            given_up: get(&self.given_up),
        }
    }
}

/// The way to the writer.
#[derive(Debug)]
pub(super) struct Writer {
    /// None once it was closed. Unbounded, but whoever sends a command waits for its answer: there are no more than there
    /// are askers.
    commands: Mutex<Option<mpsc::Sender<Box<dyn Pending>>>>,
    closed: CancellationToken,
    pub counters: Arc<Counters>,
}

impl Writer {
    /// Starts the writer on an open connection to the file at `path`; after a failure it opens another one.
    pub fn start(
        connection: Connection,
        path: PathBuf,
        listeners: Arc<Listeners>,
        damage: Arc<Damage>,
        faults: Faults,
    ) -> io::Result<Self> {
        let (commands, inbox) = mpsc::channel();
        let closed = CancellationToken::new();
        let counters = Arc::<Counters>::default();
        let connection = Some(connection);
        let worker = Worker { connection, path, listeners, damage, faults, counters: Arc::clone(&counters) };
        let done = closed.clone().drop_guard();
        thread::Builder::new().name("store-writer".to_owned()).spawn(move || {
            worker.run(&inbox);
            drop(done);
        })?;
        Ok(Self { commands: Mutex::new(Some(commands)), closed, counters })
    }

    /// Has a command carried out, and waits until that is on the disk.
    pub async fn carry_out<C: Command>(&self, command: C) -> Result<C::Output> {
        let (reply, answer) = oneshot::channel();
        self.send(Box::new(Asked { command, outcome: None, reply: Some(reply) }))?;
        answer.await.map_err(|_| closed())?
    }

    fn send(&self, command: Box<dyn Pending>) -> Result<()> {
        self.commands().as_ref().and_then(|commands| commands.send(command).ok()).ok_or_else(closed)
    }

    /// Carries out what was asked for, and closes the connection.
    pub async fn close(&self) {
        drop(self.commands().take());
        self.closed.cancelled().await;
    }

    fn commands(&self) -> MutexGuard<'_, Option<mpsc::Sender<Box<dyn Pending>>>> {
        self.commands.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A command and whoever waits for its answer.
struct Asked<C: Command> {
    command: C,
    outcome: Option<Result<C::Output>>,
    reply: Option<oneshot::Sender<Result<C::Output>>>,
}

trait Pending: Send {
    /// Carries the command out, and keeps the answer. An error means that the transaction failed.
    fn apply(&mut self, batch: &mut Batch<'_>) -> Result<()>;

    /// Gives the answer: the one that was kept, or why the transaction failed.
    fn settle(&mut self, failed: Option<Error>);
}

impl<C: Command> Pending for Asked<C> {
    fn apply(&mut self, batch: &mut Batch<'_>) -> Result<()> {
        // What it left half done goes with the transaction.
        let outcome = match catch_unwind(AssertUnwindSafe(|| self.command.apply(batch))) {
            Ok(Ok(output)) => Ok(output),
            Ok(Err(Abort::Refused(error))) => Err(error),
            Ok(Err(Abort::Broken(error))) => return Err(error),
            Err(_) => {
                let why = "a change of a job ran into a defect of the service; its log says more";
                return Err(Error::new(Kind::Internal, why));
            }
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
    connection: Option<Connection>,
    path: PathBuf,
    listeners: Arc<Listeners>,
    damage: Arc<Damage>,
    faults: Faults,
    counters: Arc<Counters>,
}

impl Worker {
    /// Works until nobody can ask for anything any more.
    fn run(mut self, inbox: &mpsc::Receiver<Box<dyn Pending>>) {
        let mut batch = Vec::new();
        while let Ok(command) = inbox.recv() {
            batch.extend(iter::once(command).chain(inbox.try_iter()).take(BATCH));
            self.carry_out(&mut batch);
            batch.clear();
        }
        if let Some(Err((_, error))) = self.connection.take().map(Connection::close) {
            tracing::warn!(%error, "the database was not closed in order; it is whole all the same");
        }
    }

    fn carry_out(&mut self, batch: &mut [Box<dyn Pending>]) {
        let Err(error) = self.commit(batch) else {
            batch.iter_mut().for_each(|command| command.settle(None));
            return;
        };
        if let [command] = batch {
            command.settle(Some(error));
            return;
        }
        tracing::debug!(%error, commands = batch.len(), "a transaction failed; its commands are tried one by one");
        for command in batch {
            let failed = self.commit(slice::from_mut(command)).err();
            command.settle(failed);
        }
    }

    /// One transaction, and what is told after it.
    fn commit(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<()> {
        let started = Instant::now();
        let outcome = self.transaction(batch).inspect_err(|error| self.damage.note(error));
        self.counters.busy_us.fetch_add(started.elapsed().as_micros() as u64, Ordering::Relaxed);
        match outcome {
            Ok(effects) => {
                self.counters.commits.fetch_add(1, Ordering::Relaxed);
                self.counters.commands.fetch_add(batch.len() as u64, Ordering::Relaxed);
                self.counters.attempts_failed.fetch_add(effects.attempts_failed, Ordering::Relaxed);
                self.counters.given_up.fetch_add(effects.given_up, Ordering::Relaxed);
                self.listeners.tell(effects);
                Ok(())
            }
            Err(error) => {
                self.counters.failures.fetch_add(1, Ordering::Relaxed);
                // Whatever state it is in: the next transaction gets a new one.
                self.connection = None;
                Err(error)
            }
        }
    }

    fn transaction(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<Effects> {
        let connection = match &mut self.connection {
            Some(connection) => connection,
            none => none.insert(connections::writing(&self.path, false)?),
        };
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let mut all = Batch { connection: &transaction, effects: Effects::default() };
        for command in batch {
            command.apply(&mut all)?;
        }
        let effects = all.effects;
        self.faults
            .hit(FaultPoint::Commit)
            .map_err(|error| Error::new(Kind::of_storage(&error), format_args!("the store of jobs failed: {error}")))?;
        transaction.commit()?;
        Ok(effects)
    }
}
