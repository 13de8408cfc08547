//! The one writer: a thread that makes every change of a job, many in one transaction.
//!
//! A commit waits for the disk. Commands that arrive during that wait go into the next transaction together (group
//! commit): commits are few under load, and a command waits for two of them at most. Answers are sent, and waiting
//! tasks woken, after the commit. When a transaction fails, each of its commands is tried once more in a transaction of
//! its own: a command that the database refuses, or that panics, fails alone.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Instant;
use std::{io, iter, slice, thread};

use parking_lot::Mutex;
use rusqlite::{Connection, TransactionBehavior};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use super::super::pulses::{Pulses, Signal};
use super::super::{JobId, Pulse, SmallBlob, Statistics};
use super::check::Damage;
use super::claim_memory::ClaimMemory;
use super::connections::{Abort, Place, closed};
use super::uploads::Uploads;
use crate::error::{Error, Kind, Result};
use crate::service::faults::{FaultPoint, Faults};

/// Commands in one transaction, at most: a bound on what fails together and on how long others wait.
const BATCH: usize = 256;

/// The transaction that a command is part of.
pub(super) struct Batch<'c> {
    /// Where to write.
    pub connection: &'c Connection,
    /// What is published after the commit.
    pub effects: Effects,
}

/// What is published once the transaction is committed.
#[derive(Debug, Default)]
pub(super) struct Effects {
    /// Jobs that are new, with their small blobs.
    pub uploads: Vec<(JobId, Vec<SmallBlob>)>,
    /// Jobs that changed.
    pub pulses: Vec<(JobId, Pulse)>,
    /// Jobs that are gone.
    pub deleted: Vec<JobId>,
    /// Whether a job can be claimed that could not be before.
    pub arrivals: bool,
    /// Whether a job ended: another one may be claimed in its stead.
    pub ends: bool,
    /// Whether the file has fewer pages, which it gives back when the log is written into it.
    pub shrinks: bool,
    /// Whether a job with a webhook ended.
    pub endings: bool,
    /// Whether the next transaction gets a new connection.
    pub reopens: bool,
    /// As in [`Statistics`].
    pub attempts_failed: u64,
    /// As in [`Statistics`].
    pub given_up: u64,
}

/// Tasks that wait for changes, what claims keep between them, and uploads that they read soon.
#[derive(Debug, Default)]
pub(super) struct Listeners {
    pub pulses: Pulses,
    pub arrivals: Signal,
    pub endings: Signal,
    pub claims: Mutex<ClaimMemory>,
    pub uploads: Mutex<Uploads>,
}

impl Listeners {
    fn publish(&self, effects: Effects) {
        let mut uploads = self.uploads.lock();
        effects.uploads.into_iter().for_each(|(id, blobs)| uploads.keep(id, blobs));
        effects.pulses.iter().filter(|(_, pulse)| pulse.ended).for_each(|(id, _)| uploads.forget(*id));
        drop(uploads);
        for (id, pulse) in effects.pulses {
            self.pulses.publish(id, pulse);
        }
        for id in effects.deleted {
            self.pulses.forget(id);
        }
        if effects.arrivals || (effects.ends && self.claims.lock().has_held_back) {
            self.arrivals.notify();
        }
        if effects.endings {
            self.endings.notify();
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
    /// None once it was closed. Unbounded, but every sender waits for the answer to its command.
    commands: Mutex<Option<mpsc::Sender<Box<dyn Pending>>>>,
    closed: CancellationToken,
    pub counters: Arc<Counters>,
}

impl Writer {
    /// Starts the writer on an open connection to a file; after a failure it opens another one.
    pub fn start(
        connection: Connection,
        place: Arc<Place>,
        listeners: Arc<Listeners>,
        damage: Arc<Damage>,
        faults: Faults,
    ) -> io::Result<Self> {
        let (commands, inbox) = mpsc::channel();
        let closed = CancellationToken::new();
        let counters = Arc::<Counters>::default();
        let connection = Some(connection);
        let worker = Worker { connection, place, listeners, damage, faults, counters: Arc::clone(&counters) };
        let done = closed.clone().drop_guard();
        thread::Builder::new().name("store-writer".to_owned()).spawn(move || {
            worker.run(&inbox);
            drop(done);
        })?;
        Ok(Self { commands: Mutex::new(Some(commands)), closed, counters })
    }

    /// Runs a command, and waits until the disk has its changes. A command [refuses](Abort::Refused) before it writes;
    /// it runs again after a transaction that failed.
    pub async fn carry_out<T, C>(&self, command: C) -> Result<T>
    where
        T: Send + 'static,
        C: Fn(&mut Batch<'_>) -> Result<T, Abort> + Send + 'static,
    {
        let (reply, answer) = oneshot::channel();
        let sent = Box::new(Sent { command, outcome: None, reply: Some(reply) });
        self.commands.lock().as_ref().and_then(|commands| commands.send(sent).ok()).ok_or_else(closed)?;
        answer.await.map_err(|_| closed())?
    }

    /// Runs the commands that were sent, and closes the connection.
    pub async fn close(&self) {
        drop(self.commands.lock().take());
        self.closed.cancelled().await;
    }
}

/// A command and the way back for its answer.
struct Sent<T, C> {
    command: C,
    outcome: Option<Result<T>>,
    reply: Option<oneshot::Sender<Result<T>>>,
}

trait Pending: Send {
    /// Runs the command, and keeps the answer. An error means that the transaction failed.
    fn apply(&mut self, batch: &mut Batch<'_>) -> Result<()>;

    /// Sends the answer: the one that was kept, or why the transaction failed.
    fn settle(&mut self, failed: Option<Error>);
}

impl<T: Send, C: Fn(&mut Batch<'_>) -> Result<T, Abort> + Send> Pending for Sent<T, C> {
    fn apply(&mut self, batch: &mut Batch<'_>) -> Result<()> {
        // a panic rolls the transaction back
        let outcome = match catch_unwind(AssertUnwindSafe(|| (self.command)(batch))) {
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
            // the sender may have given up
            let _ = reply.send(answer);
        }
    }
}

struct Worker {
    /// None after a failure, until the next command.
    connection: Option<Connection>,
    place: Arc<Place>,
    listeners: Arc<Listeners>,
    damage: Arc<Damage>,
    faults: Faults,
    counters: Arc<Counters>,
}

impl Worker {
    /// Works until the writer is closed.
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

    /// One transaction, and what is published after it.
    fn commit(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<()> {
        let started = Instant::now();
        let outcome = self.transaction(batch).map_err(|error| self.damage.note(error));
        self.counters.busy_us.fetch_add(started.elapsed().as_micros() as u64, Ordering::Relaxed);
        match outcome {
            Ok(effects) => {
                self.counters.commits.fetch_add(1, Ordering::Relaxed);
                self.counters.commands.fetch_add(batch.len() as u64, Ordering::Relaxed);
                self.counters.attempts_failed.fetch_add(effects.attempts_failed, Ordering::Relaxed);
                self.counters.given_up.fetch_add(effects.given_up, Ordering::Relaxed);
                self.listeners.publish(effects);
                Ok(())
            }
            Err(error) => {
                self.counters.failures.fetch_add(1, Ordering::Relaxed);
                // its state is unknown: the next transaction gets a new one
                self.connection = None;
                Err(error)
            }
        }
    }

    fn transaction(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<Effects> {
        let connection = match &mut self.connection {
            Some(connection) => connection,
            none => none.insert(self.place.writing(false)?),
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
        if effects.shrinks {
            // as far as readers allow; the transaction is committed whatever comes of it
            let written = connection.query_row("PRAGMA wal_checkpoint(PASSIVE)", [], |_| Ok(()));
            let _ = written.inspect_err(|error| tracing::debug!(%error, "the log was not written into the store"));
        }
        if effects.reopens {
            self.connection = None;
        }
        Ok(effects)
    }
}
