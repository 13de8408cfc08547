//! What one service has of the store.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use deadpool_postgres::{Object, Transaction};
use futures_util::future::BoxFuture;
use parking_lot::Mutex;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use uuid::Uuid;

use super::super::cursor::Cursors;
use super::super::url::StoreUrl;
use super::super::{Rules, State, Ticket};
use super::address::Address;
use super::connections::{Connections, Failure, cannot_reach, execute, one};
use super::hints::Hints;
use super::live::Effects;
use super::rows::column;
use super::schema;
use crate::error::{Error, Kind, Result};

/// A store in a database that several services share.
#[derive(Debug)]
pub(in crate::service) struct PostgresStore {
    pub(super) rules: Rules,
    /// This process among the services: new at every start.
    pub(super) me: Uuid,
    pub(super) connections: Arc<Connections>,
    pub(super) hints: Arc<Hints>,
    pub(super) cursors: Cursors,
    name: String,
    /// Numbers of the last events of the jobs that are claimed here: no other service appends to them.
    pub(super) held: Mutex<HashMap<Ticket, u64>>,
    /// Held while jobs are claimed. Whether a claim ended without an answer: it may have taken jobs.
    pub(super) is_unsure: tokio::sync::Mutex<bool>,
    pub(super) attempts_failed: AtomicU64,
    pub(super) given_up: AtomicU64,
    /// Counts of jobs in each state, and when they were read: counting the ended ones takes long.
    pub(super) counts: Mutex<Option<(Instant, [u64; State::ALL.len()])>>,
    stop: CancellationToken,
    tasks: TaskTracker,
}

impl PostgresStore {
    /// Opens the store with at most so many connections beside one for notifications, and makes its tables if need be.
    pub async fn open(url: &StoreUrl, most: usize, rules: Rules) -> Result<Self> {
        let address = Address::parse(url)?;
        let connections = Arc::new(Connections::new(&address, most)?);
        let opened = connections.run(|mut client| async move {
            schema::migrate(&mut client).await?;
            let new = Cursors::random()?;
            let sql = "INSERT INTO secrets (id, cursors) VALUES (1, $1) ON CONFLICT (id) DO NOTHING";
            execute(&client, sql, &[&new.key()]).await?;
            let row = one(&client, "SELECT cursors, name::text FROM secrets WHERE id = 1", &[]).await?;
            let key: Vec<u8> = column(&row, "cursors")?;
            let damaged = || Error::new(Kind::Internal, "the key of cursors in the store of jobs is damaged");
            Ok((Cursors::with_key(&key).ok_or_else(damaged)?, column::<String>(&row, "name")?))
        });
        let (cursors, name) = opened.await.map_err(cannot_reach)?;
        let (me, stop) = (Uuid::new_v4(), CancellationToken::new());
        let hints = Arc::new(Hints::new(me));
        let tasks = hints.start(&connections, &address, &stop)?;
        Ok(Self {
            rules,
            me,
            connections,
            hints,
            cursors,
            name,
            held: Mutex::default(),
            is_unsure: tokio::sync::Mutex::new(false),
            attempts_failed: AtomicU64::new(0),
            given_up: AtomicU64::new(0),
            counts: Mutex::default(),
            stop,
            tasks,
        })
    }

    /// The name of the store, by which its files are known.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Does a change in a transaction, and what follows from it.
    pub(super) async fn change<T: Send>(
        &self,
        work: impl for<'t> Fn(&'t Transaction<'t>, &'t mut Effects) -> BoxFuture<'t, Result<T, Failure>> + Send + Sync,
    ) -> Result<T> {
        let work = &work;
        let (done, effects) = self
            .connections
            .run(|mut client: Object| async move {
                let mut effects = Effects::default();
                let transaction = client.transaction().await?;
                let done = work(&transaction, &mut effects).await?;
                transaction.commit().await?;
                Ok((done, effects))
            })
            .await?;
        self.follow(&effects);
        Ok(done)
    }

    /// Does what follows from a change.
    pub(super) fn follow(&self, effects: &Effects) {
        self.attempts_failed.fetch_add(effects.attempts_failed, Ordering::Relaxed);
        self.given_up.fetch_add(effects.given_up, Ordering::Relaxed);
        self.hints.tell(effects);
    }

    /// Ends the tasks and the connections.
    pub(super) async fn shut(&self) {
        self.stop.cancel();
        self.tasks.wait().await;
        self.connections.close();
    }
}

impl Drop for PostgresStore {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}
