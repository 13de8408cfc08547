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
use tesserae_mesh::error::{Error, Result};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use super::super::super::listeners::{Effects, Listeners};
use super::super::{Abort, Rows};
use super::place::{DatabasePlace, closed, failure};
use crate::ops::faults::{FaultPoint, Faults};

/// An error means that the transaction failed.
type Work = dyn FnMut(&mut Connection, &mut Effects) -> Result<()> + Send;

struct Command {
    work: Box<Work>,
    /// Gets the outcome of the transaction.
    reply: oneshot::Sender<Result<()>>,
}

pub struct Writer {
    /// None once it was closed. Unbounded, but every sender waits for the answer to its command.
    commands: Mutex<Option<mpsc::Sender<Command>>>,
    closed: CancellationToken,
}

impl Writer {
    /// Makes a change; returns when it is on the disk, and what follows from it is done. A command
    /// [refuses](Abort::Refused) before it writes; it runs again after a transaction that failed.
    pub async fn change<T: Send + 'static>(
        &self,
        command: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let outcome = Arc::new(Mutex::new(None));
        let kept = Arc::clone(&outcome);
        let work = move |connection: &mut Connection, effects: &mut Effects| {
            // a panic rolls the transaction back
            *kept.lock() = Some(match catch_unwind(AssertUnwindSafe(|| command(connection, effects))) {
                Ok(Ok(output)) => Ok(output),
                Ok(Err(Abort::Refused(error))) => Err(error),
                Ok(Err(abort)) => return Err(abort.into_error()),
                Err(_) => {
                    let why = "a change of a job ran into a defect of the service; its log says more";
                    return Err(Error::internal(why));
                }
            });
            Ok(())
        };
        let (reply, answer) = oneshot::channel();
        let sent = Command { work: Box::new(work), reply };
        self.commands.lock().as_ref().and_then(|commands| commands.send(sent).ok()).ok_or_else(closed)?;
        answer.await.map_err(|_| closed())??;
        outcome.lock().take().ok_or_else(closed)?
    }

    /// Runs the commands that were sent, and closes the connection.
    pub async fn close(&self) {
        drop(self.commands.lock().take());
        self.closed.cancelled().await;
    }
}

pub struct WriterThread {
    /// None after a failure, until the next command.
    pub connection: Option<Connection>,
    pub place: Arc<DatabasePlace>,
    pub listeners: Arc<Listeners>,
    pub faults: Faults,
}

impl WriterThread {
    /// Starts the thread.
    pub fn start(self) -> io::Result<Writer> {
        let (commands, inbox) = mpsc::channel();
        let closed = CancellationToken::new();
        let done = closed.clone().drop_guard();
        thread::Builder::new().name("store-writer".to_owned()).spawn(move || {
            self.run(&inbox);
            drop(done);
        })?;
        Ok(Writer { commands: Mutex::new(Some(commands)), closed })
    }

    fn run(mut self, inbox: &mpsc::Receiver<Command>) {
        while let Ok(command) = inbox.recv() {
            // a bound on what fails together, and on how long others wait
            self.carry_out(iter::once(command).chain(inbox.try_iter()).take(256).collect());
        }
        if let Some(connection) = self.connection.take()
            && let Err((_, error)) = connection.close()
        {
            tracing::warn!(%error, "the database was not closed in order; it is whole all the same");
        }
    }

    fn carry_out(&mut self, mut batch: Vec<Command>) {
        let outcome = self.commit(&mut batch);
        let is_one = batch.len() == 1;
        if let Err(error) = &outcome
            && !is_one
        {
            tracing::debug!(%error, commands = batch.len(), "a transaction failed; its commands are tried one by one");
        }
        for mut command in batch {
            let outcome = match &outcome {
                Err(_) if !is_one => self.commit(slice::from_mut(&mut command)),
                outcome => outcome.clone(),
            };
            // the sender may have given up
            let _ = command.reply.send(outcome);
        }
    }

    fn commit(&mut self, batch: &mut [Command]) -> Result<()> {
        let started = Instant::now();
        match self.transaction(batch) {
            Ok(effects) => {
                self.listeners.count(Some(batch.len()), started.elapsed());
                self.listeners.publish(effects);
                Ok(())
            }
            Err(error) => {
                self.listeners.count(None, started.elapsed());
                // its state is unknown: the next transaction gets a new one
                self.connection = None;
                Err(self.place.note(error))
            }
        }
    }

    fn transaction(&mut self, batch: &mut [Command]) -> Result<Effects> {
        let connection = match &mut self.connection {
            Some(connection) => connection,
            none => none.insert(self.place.writing().map_err(failure)?),
        };
        connection.execute_batch("BEGIN IMMEDIATE").map_err(failure)?;
        let mut effects = Effects::default();
        for command in batch {
            (command.work)(connection, &mut effects)?;
        }
        self.faults.hit(FaultPoint::Commit).map_err(|error| Error::storage("the store of jobs failed", error))?;
        connection.execute_batch("COMMIT").map_err(failure)?;
        if effects.shrinks {
            // as far as readers allow; the transaction is committed whatever comes of it
            let written = connection.query_row("PRAGMA wal_checkpoint(PASSIVE)", [], |_| Ok(()));
            let _ = written.inspect_err(|error| tracing::debug!(%error, "the log was not written into the store"));
        }
        Ok(effects)
    }
}
