//! The one writer: a thread that makes every change of a job, many in one transaction.
//!
//! A commit waits for the disk. Commands that arrive during that wait go into the next transaction together (group
//! commit): commits are few under load, and a command waits for two of them at most. Answers are sent, and waiting
//! tasks woken, after the commit. When a transaction fails, each of its commands is tried once more in a transaction of
//! its own: a command that the database refuses, or that panics, fails alone.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};
use std::time::Instant;
use std::{io, iter, slice, thread};

use parking_lot::Mutex;
use rusqlite::Connection;
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use super::super::super::listeners::{Effects, Listeners};
use super::super::rows::{Abort, Rows};
use super::check::Damage;
use super::place::{DatabasePlace, closed, failure};
use super::session::Session;
use crate::ops::faults::{FaultPoint, Faults};

/// Commands in one transaction, at most: a bound on what fails together and on how long others wait.
const BATCH: usize = 256;

#[derive(Debug)]
pub struct Writer {
    /// None once it was closed. Unbounded, but every sender waits for the answer to its command.
    commands: Mutex<Option<mpsc::Sender<Box<dyn Pending>>>>,
    closed: CancellationToken,
}

impl Writer {
    /// Starts the writer on an open connection to a file; after a failure it opens another one.
    pub fn start(
        connection: Connection,
        place: Arc<DatabasePlace>,
        listeners: Arc<Listeners>,
        damage: Arc<Damage>,
        faults: Faults,
    ) -> io::Result<Self> {
        let (commands, inbox) = mpsc::channel();
        let closed = CancellationToken::new();
        let session = Some(Session::new(connection));
        let worker = Worker { session, place, listeners, damage, faults };
        let done = closed.clone().drop_guard();
        thread::Builder::new().name("store-writer".to_owned()).spawn(move || {
            worker.run(&inbox);
            drop(done);
        })?;
        Ok(Self { commands: Mutex::new(Some(commands)), closed })
    }

    /// Makes a change; returns when it is on the disk, and what follows from it is done. A command
    /// [refuses](Abort::Refused) before it writes; it runs again after a transaction that failed.
    pub async fn change<T: Send + 'static>(
        &self,
        command: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let (reply, answer) = oneshot::channel();
        let sent = Box::new(Sent { command, outcome: None, reply });
        self.commands.lock().as_ref().and_then(|commands| commands.send(sent).ok()).ok_or_else(closed)?;
        answer.await.map_err(|_| closed())?
    }

    /// Runs the commands that were sent, and closes the connection.
    pub async fn close(&self) {
        drop(self.commands.lock().take());
        self.closed.cancelled().await;
    }
}

struct Sent<T, C> {
    command: C,
    outcome: Option<Result<T>>,
    reply: oneshot::Sender<Result<T>>,
}

trait Pending: Send {
    /// Runs the command, and keeps the answer. An error means that the transaction failed.
    fn apply(&mut self, session: &mut Session, effects: &mut Effects) -> Result<()>;

    /// Sends the answer: the one that was kept, or why the transaction failed.
    fn settle(self: Box<Self>, failed: Option<Error>);
}

impl<T: Send, C: Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send> Pending for Sent<T, C> {
    fn apply(&mut self, session: &mut Session, effects: &mut Effects) -> Result<()> {
        // a panic rolls the transaction back
        let outcome = match catch_unwind(AssertUnwindSafe(|| (self.command)(session, effects))) {
            Ok(Ok(output)) => Ok(output),
            Ok(Err(Abort::Refused(error))) => Err(error),
            Ok(Err(abort)) => return Err(abort.into_error()),
            Err(_) => {
                let why = "a change of a job ran into a defect of the service; its log says more";
                return Err(Error::new(Kind::Internal, why));
            }
        };
        self.outcome = Some(outcome);
        Ok(())
    }

    fn settle(self: Box<Self>, failed: Option<Error>) {
        let forgotten = || Err(Error::new(Kind::Internal, "a change of a job was forgotten"));
        let Self { outcome, reply, .. } = *self;
        // the sender may have given up
        let _ = reply.send(failed.map_or_else(|| outcome.unwrap_or_else(forgotten), Err));
    }
}

struct Worker {
    /// None after a failure, until the next command.
    session: Option<Session>,
    place: Arc<DatabasePlace>,
    listeners: Arc<Listeners>,
    damage: Arc<Damage>,
    faults: Faults,
}

impl Worker {
    fn run(mut self, inbox: &mpsc::Receiver<Box<dyn Pending>>) {
        while let Ok(command) = inbox.recv() {
            self.carry_out(iter::once(command).chain(inbox.try_iter()).take(BATCH).collect());
        }
        if let Some(session) = self.session.take()
            && let Err((_, error)) = session.connection.close()
        {
            tracing::warn!(%error, "the database was not closed in order; it is whole all the same");
        }
    }

    fn carry_out(&mut self, mut batch: Vec<Box<dyn Pending>>) {
        let failed = self.commit(&mut batch).err();
        let is_one = batch.len() == 1;
        if let Some(error) = failed.as_ref().filter(|_| !is_one) {
            tracing::debug!(%error, commands = batch.len(), "a transaction failed; its commands are tried one by one");
        }
        for mut command in batch {
            let failed = match &failed {
                Some(_) if !is_one => self.commit(slice::from_mut(&mut command)).err(),
                failed => failed.clone(),
            };
            command.settle(failed);
        }
    }

    fn commit(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<()> {
        let started = Instant::now();
        let outcome = self.transaction(batch).map_err(|error| self.damage.note(error));
        match outcome {
            Ok(effects) => {
                self.listeners.committed(batch.len(), started.elapsed());
                self.listeners.publish(effects);
                Ok(())
            }
            Err(error) => {
                self.listeners.failed(started.elapsed());
                // its state is unknown: the next transaction gets a new one
                self.session = None;
                Err(error)
            }
        }
    }

    fn transaction(&mut self, batch: &mut [Box<dyn Pending>]) -> Result<Effects> {
        let session = match &mut self.session {
            Some(session) => session,
            none => none.insert(Session::new(self.place.writing().map_err(failure)?)),
        };
        session.begin().map_err(failure)?;
        let mut effects = Effects::default();
        for command in batch {
            command.apply(session, &mut effects)?;
        }
        self.faults
            .hit(FaultPoint::Commit)
            .map_err(|error| Error::new(Kind::of_storage(&error), format_args!("the store of jobs failed: {error}")))?;
        session.commit().map_err(failure)?;
        if effects.shrinks {
            // as far as readers allow; the transaction is committed whatever comes of it
            let written = session.connection.query_row("PRAGMA wal_checkpoint(PASSIVE)", [], |_| Ok(()));
            let _ = written.inspect_err(|error| tracing::debug!(%error, "the log was not written into the store"));
        }
        Ok(effects)
    }
}
