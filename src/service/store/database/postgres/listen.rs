//! How services learn what others did: by notifications, and by a look at the tables every second.
//!
//! A notification is a hint. It may be late or lost, as when the connection breaks, and only makes the look come
//! sooner. Notifications are sent together, in a statement of their own, at most every [`PAUSE`]: PostgreSQL lets one
//! transaction with notifications commit at a time.

use std::collections::HashSet;
use std::future::poll_fn;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tesserae_mesh::error::Result;
use tokio::sync::Notify;
use tokio::time::{Instant, timeout_at};
use tokio_postgres::tls::{MakeTlsConnect, TlsConnect};
use tokio_postgres::types::ToSql;
use tokio_postgres::{AsyncMessage, NoTls, Socket};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use uuid::Uuid;

use super::super::super::job::JobId;
use super::super::super::listeners::{ARRIVAL, ENDING, Listeners};
use super::super::super::terms::Pulse;
use super::super::rows::Row;
use super::address::Address;
use super::connections::{Connections, PATIENCE, encryption};
use super::session::read;

/// Time between two looks at what is waited for.
const LOOK: Duration = Duration::from_secs(1);

/// Least time between two statements with notifications.
const PAUSE: Duration = Duration::from_millis(100);

/// Looks after which deliveries of webhooks look, too.
const SELDOM: u64 = 10;

/// The tasks that send and receive notifications.
#[derive(Debug)]
pub struct Hints {
    /// This process among the services, in every notification: it skips its own.
    me: Uuid,
    listeners: Arc<Listeners>,
    connections: Connections,
    /// Jobs that others changed and tasks wait for here.
    heard: Mutex<HashSet<JobId>>,
    heard_of: Notify,
}

impl Hints {
    /// Starts the tasks, which run until `stop`.
    pub fn start(
        me: Uuid,
        listeners: Arc<Listeners>,
        connections: &Connections,
        address: &Address,
        stop: &CancellationToken,
    ) -> Result<TaskTracker> {
        let (heard, heard_of) = (Mutex::default(), Notify::new());
        let this = Arc::new(Self { me, listeners, connections: connections.clone(), heard, heard_of });
        let tasks = TaskTracker::new();
        let (sending, looking, address) = (Arc::clone(&this), Arc::clone(&this), address.clone());
        let tls = encryption(&address)?;
        tasks.spawn(stop.clone().run_until_cancelled_owned(async move { sending.send().await }));
        tasks.spawn(stop.clone().run_until_cancelled_owned(async move { looking.look().await }));
        tasks.spawn(stop.clone().run_until_cancelled_owned(async move {
            match tls {
                Some(tls) => this.listen(&address, tls).await,
                None => this.listen(&address, NoTls).await,
            }
        }));
        tasks.close();
        Ok(tasks)
    }

    /// Tells other services what changed here.
    async fn send(&self) {
        let Some(outbox) = &self.listeners.outbox else { return };
        loop {
            outbox.filled.notified().await;
            let waiting = std::mem::take(&mut *outbox.waiting.lock());
            let payloads: Vec<String> = waiting.iter().map(|what| format!("{} {what}", self.me)).collect();
            let sql = "SELECT count(pg_notify('tesserae', payload)) FROM unnest($1::text[]) AS payload";
            if self.rows(sql, &[&payloads]).await.is_none() {
                tracing::debug!("other services were not told what changed: they look by themselves");
            }
            tokio::time::sleep(PAUSE).await;
        }
    }

    /// The rows of a query; none where the database fails.
    async fn rows(&self, sql: &str, values: &[&(dyn ToSql + Sync)]) -> Option<Vec<Row>> {
        let deadline = Instant::now() + PATIENCE;
        let client = self.connections.get(deadline).await.ok()?;
        let found = timeout_at(deadline, async {
            let statement = client.prepare_cached(sql).await?;
            client.query(&statement, values).await
        });
        read(found.await.ok()?.ok()?).ok()
    }

    /// Looks every second at the jobs that tasks wait for, and lets workers look at the queue; at jobs that others
    /// changed at once.
    async fn look(&self) {
        let mut next = Instant::now() + LOOK;
        let mut turns = 0u64;
        loop {
            if timeout_at(next, self.heard_of.notified()).await.is_ok() {
                let heard = std::mem::take(&mut *self.heard.lock());
                self.refresh(heard.into_iter().collect()).await;
                continue;
            }
            let sql = "SELECT FROM jobs WHERE state = 'queued' LIMIT 1";
            let started = Instant::now();
            match self.rows(sql, &[]).await {
                Some(rows) if rows.is_empty() => {}
                Some(_) => self.listeners.arrivals.notify(),
                None => self.listeners.failed(started.elapsed()),
            }
            if turns.is_multiple_of(SELDOM) {
                self.listeners.endings.notify();
            }
            turns += 1;
            self.refresh(self.listeners.pulses.waited_for()).await;
            next = Instant::now() + LOOK;
        }
    }

    /// Reads the state of jobs anew for the tasks that wait for them.
    async fn refresh(&self, jobs: Vec<JobId>) {
        if jobs.is_empty() {
            return;
        }
        let ids: Vec<String> = jobs.iter().map(JobId::to_string).collect();
        let sql = "SELECT id, last_seq, cancel_requested, state FROM jobs WHERE id = ANY ($1)";
        let Some(found) = self.rows(sql, &[&ids]).await else { return };
        let mut deleted: HashSet<JobId> = jobs.into_iter().collect();
        for row in &found {
            if let (Ok(id), Ok(pulse)) = (row.get("id"), Pulse::of(row)) {
                deleted.remove(&id);
                self.listeners.pulses.publish(id, pulse);
            }
        }
        deleted.into_iter().for_each(|id| self.listeners.pulses.forget(id));
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
            ARRIVAL => self.listeners.arrivals.notify(),
            ENDING => self.listeners.endings.notify(),
            id => {
                if let Some(id) = id.parse().ok().filter(|id| self.listeners.pulses.is_waited_for(*id)) {
                    self.heard.lock().insert(id);
                    self.heard_of.notify_one();
                }
            }
        }
    }
}
