//! How services learn what others did: by notifications, and by a look at the tables every second.
//!
//! A notification is a hint. It may be late or lost, as when the connection breaks, and only makes the look come
//! sooner. Notifications are sent together, in a statement of their own, at most every [`PAUSE`]: PostgreSQL lets one
//! transaction with notifications commit at a time.

use std::collections::{BTreeSet, HashSet};
use std::future::poll_fn;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::Notify;
use tokio::time::{Instant, timeout_at};
use tokio_postgres::tls::{MakeTlsConnect, TlsConnect};
use tokio_postgres::{AsyncMessage, NoTls, Socket};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use uuid::Uuid;

use super::super::JobId;
use super::super::pulses::{Pulses, Signal};
use super::address::Address;
use super::connections::{Connections, all, encryption, execute, one};
use super::live::Effects;
use super::rows;
use crate::error::Result;

/// Time between two looks at what is waited for.
const LOOK: Duration = Duration::from_secs(1);

/// Least time between two statements with notifications.
const PAUSE: Duration = Duration::from_millis(100);

/// Looks after which deliveries of webhooks look, too.
const SELDOM: u64 = 10;

/// Notifications of an arrival, and of an end with a webhook; that of a change of a job is its id.
const ARRIVAL: &str = "arrival";
const ENDING: &str = "ending";

/// The waiting tasks of this process, and the hints for other services.
#[derive(Debug)]
pub(super) struct Hints {
    /// This process among the services, in every notification: it skips its own.
    me: Uuid,
    pub arrivals: Signal,
    pub endings: Signal,
    pub pulses: Pulses,
    /// What is to be told.
    outbox: Mutex<BTreeSet<String>>,
    filled: Notify,
    /// Jobs that others changed and tasks wait for here.
    heard: Mutex<HashSet<JobId>>,
    heard_of: Notify,
}

impl Hints {
    pub fn new(me: Uuid) -> Self {
        let (arrivals, endings, pulses) = (Signal::default(), Signal::default(), Pulses::default());
        let (outbox, heard) = (Mutex::default(), Mutex::default());
        Self { me, arrivals, endings, pulses, outbox, filled: Notify::new(), heard, heard_of: Notify::new() }
    }

    /// Wakes the tasks that waited for a change, here and in other services.
    pub fn tell(&self, effects: &Effects) {
        let mut outbox = self.outbox.lock();
        for (id, pulse) in &effects.pulses {
            self.pulses.publish(*id, *pulse);
            outbox.insert(id.to_string());
        }
        if effects.arrivals {
            outbox.insert(ARRIVAL.to_owned());
        }
        if effects.endings {
            self.endings.notify();
            outbox.insert(ENDING.to_owned());
        }
        let is_filled = !outbox.is_empty();
        drop(outbox);
        if effects.arrivals || effects.ends {
            self.arrivals.notify();
        }
        if is_filled {
            self.filled.notify_one();
        }
    }

    /// Starts the tasks, which run until `stop`.
    pub fn start(
        self: &Arc<Self>,
        connections: &Arc<Connections>,
        address: &Address,
        stop: &CancellationToken,
    ) -> Result<TaskTracker> {
        let tasks = TaskTracker::new();
        let (hints, sending) = (Arc::clone(self), Arc::clone(connections));
        tasks.spawn(stop.clone().run_until_cancelled_owned(async move { hints.send(&sending).await }));
        let (hints, looking) = (Arc::clone(self), Arc::clone(connections));
        tasks.spawn(stop.clone().run_until_cancelled_owned(async move { hints.look(&looking).await }));
        let (hints, address) = (Arc::clone(self), address.clone());
        let tls = encryption(&address)?;
        tasks.spawn(stop.clone().run_until_cancelled_owned(async move {
            match tls {
                Some(tls) => hints.listen(&address, tls).await,
                None => hints.listen(&address, NoTls).await,
            }
        }));
        tasks.close();
        Ok(tasks)
    }

    /// Tells other services what changed here.
    async fn send(&self, connections: &Connections) {
        loop {
            self.filled.notified().await;
            let payloads: Vec<String> =
                std::mem::take(&mut *self.outbox.lock()).iter().map(|what| format!("{} {what}", self.me)).collect();
            let payloads = &payloads;
            let sent = connections.run(|client| async move {
                let sql = "SELECT count(pg_notify('tesserae', payload)) FROM unnest($1::text[]) AS payload";
                execute(&client, sql, &[payloads]).await
            });
            if let Err(error) = sent.await {
                tracing::debug!(%error, "other services were not told what changed: they look by themselves");
            }
            tokio::time::sleep(PAUSE).await;
        }
    }

    /// Looks every second at the jobs that tasks wait for, and lets workers look at the queue; at jobs that others
    /// changed at once.
    async fn look(&self, connections: &Connections) {
        let mut next = Instant::now() + LOOK;
        let mut turns = 0u64;
        loop {
            if timeout_at(next, self.heard_of.notified()).await.is_ok() {
                let heard = std::mem::take(&mut *self.heard.lock());
                self.refresh(connections, heard.into_iter().collect()).await;
                continue;
            }
            if self.do_jobs_wait(connections).await {
                self.arrivals.notify();
            }
            if turns.is_multiple_of(SELDOM) {
                self.endings.notify();
            }
            turns += 1;
            self.refresh(connections, self.pulses.waited_for()).await;
            next = Instant::now() + LOOK;
        }
    }

    /// Whether a worker may find something to do.
    async fn do_jobs_wait(&self, connections: &Connections) -> bool {
        let found = connections.run(|client| async move {
            let sql = "SELECT EXISTS (SELECT FROM jobs WHERE state = 'queued') AS is_so";
            Ok(rows::column::<bool>(&one(&client, sql, &[]).await?, "is_so")?)
        });
        found.await.unwrap_or(false)
    }

    /// Reads the state of jobs anew for the tasks that wait for them.
    async fn refresh(&self, connections: &Connections, jobs: Vec<JobId>) {
        if jobs.is_empty() {
            return;
        }
        let ids: Vec<Uuid> = jobs.iter().map(|job| job.uuid()).collect();
        let ids = &ids;
        let found = connections.run(|client| async move {
            let sql = "SELECT id, last_seq, cancel_requested, state FROM jobs WHERE id = ANY ($1)";
            let rows = all(&client, sql, &[ids]).await?;
            Ok(rows.iter().map(|row| Ok((rows::id(row, "id")?, rows::pulse(row)?))).collect::<Result<Vec<_>>>()?)
        });
        let Ok(found) = found.await else { return };
        let mut deleted: HashSet<JobId> = jobs.into_iter().collect();
        for (id, pulse) in found {
            deleted.remove(&id);
            self.pulses.publish(id, pulse);
        }
        deleted.into_iter().for_each(|id| self.pulses.forget(id));
    }

    /// Receives notifications, with a connection of its own.
    async fn listen<T>(&self, address: &Address, tls: T)
    where
        T: MakeTlsConnect<Socket> + Clone,
        T::Stream: Send,
        T::TlsConnect: Send,
        <T::TlsConnect as TlsConnect<Socket>>::Future: Send,
    {
        loop {
            if let Ok((client, mut connection)) = address.config.connect(tls.clone()).await {
                let mut listening = Box::pin(async {
                    let _ = client.batch_execute("LISTEN tesserae").await;
                    // the connection ends with its client
                    std::future::pending::<()>().await;
                });
                loop {
                    let message = tokio::select! {
                        message = poll_fn(|context| connection.poll_message(context)) => message,
                        () = &mut listening => None,
                    };
                    match message {
                        Some(Ok(AsyncMessage::Notification(told))) => self.hear(told.payload()),
                        Some(Ok(_)) => {}
                        Some(Err(_)) | None => break,
                    }
                }
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Acts on a notification.
    fn hear(&self, payload: &str) {
        let Some((sender, what)) = payload.split_once(' ') else { return };
        if sender.parse() == Ok(self.me) {
            return;
        }
        match what {
            ARRIVAL => self.arrivals.notify(),
            ENDING => self.endings.notify(),
            id => {
                if let Some(id) = id.parse().ok().filter(|id| self.pulses.is_waited_for(*id)) {
                    self.heard.lock().insert(id);
                    self.heard_of.notify_one();
                }
            }
        }
    }
}
