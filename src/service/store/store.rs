//! The store: a database, and what one process knows beside it.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use tesserae_mesh::error::{Kind, Result};
use uuid::Uuid;

use super::change::Transaction;
use super::database::sqlite::Sqlite;
use super::database::{Abort, Row, Rows, Value, values};
#[cfg(feature = "postgres")]
use super::database::{StoreUrl, postgres::Postgres};
use super::job::Ticket;
use super::listeners::{Effects, Listeners};
use super::terms::Statistics;
use crate::ops::faults::Faults;
use crate::queue::Rules;

enum Database {
    Sqlite(Sqlite),
    #[cfg(feature = "postgres")]
    Postgres(Postgres),
}

/// Receives the name of every operation, how long it took, and whether it failed.
type Observer = Box<dyn Fn(&'static str, Duration, bool) + Send + Sync>;

/// The store of jobs. See the [module](super) for what it promises.
pub(crate) struct Store {
    database: Database,
    pub(super) rules: Rules,
    /// This process among the workers: new at every start.
    pub(super) me: Uuid,
    pub(super) listeners: Arc<Listeners>,
    /// Numbers of the last events of the jobs that are claimed here: no other process appends to them.
    pub(super) held: Mutex<HashMap<Ticket, u64>>,
    /// Whether the last claim took no job.
    pub(super) is_idle: AtomicBool,
    observer: Option<Observer>,
}

impl Store {
    /// Opens the store in the file at `path`, or makes it. No other process may have it open. A temporary file is one
    /// that the process outlasts.
    pub async fn open(path: &Path, is_temporary: bool, rules: Rules, faults: Faults) -> Result<Self> {
        let listeners = Arc::<Listeners>::default();
        let file = Sqlite::open(path, is_temporary, Arc::clone(&listeners), faults)?;
        let store = Self::with(Database::Sqlite(file), listeners, rules);
        if is_temporary {
            return Ok(store);
        }
        // one process has the file: running jobs are those of a process that ended
        match store.recover().await {
            Ok(0) => {}
            Ok(jobs) => tracing::warn!(jobs, "the service did not stop in order; jobs that ran wait again"),
            // their leases end
            Err(error) if error.kind == Kind::InsufficientStorage => {
                tracing::warn!(%error, "jobs that ran when the process died wait for room on the disk");
            }
            Err(error) => return Err(error),
        }
        Ok(store)
    }

    /// Opens the store in a database that several services share, with at most so many connections.
    #[cfg(feature = "postgres")]
    pub async fn shared(url: &StoreUrl, most: usize, rules: Rules) -> Result<Self> {
        let listeners = Arc::<Listeners>::default();
        let database = Postgres::open(url, most, Arc::clone(&listeners)).await?;
        Ok(Self::with(Database::Postgres(database), listeners, rules))
    }

    fn with(database: Database, listeners: Arc<Listeners>, rules: Rules) -> Self {
        Self {
            database,
            rules,
            me: Uuid::new_v4(),
            listeners,
            held: Mutex::default(),
            is_idle: AtomicBool::new(false),
            observer: None,
        }
    }

    /// By which its files are known; made by the first call.
    pub async fn name(&self) -> Result<String> {
        let name = Uuid::new_v4().to_string();
        self.change("open", move |change| {
            change.rows.write("UPDATE identity SET name = $1 WHERE name = ''", values![&*name])?;
            Ok(change.rows.one("SELECT name FROM identity", Vec::new())?.get("name")?)
        })
        .await
    }

    /// Lets an observer see every operation from now on.
    pub fn observe(&mut self, observer: impl Fn(&'static str, Duration, bool) + Send + Sync + 'static) {
        self.observer = Some(Box::new(observer));
    }

    /// Makes a change in a transaction, and what follows from it. The change refuses before it writes; it is made again
    /// where the database broke it off.
    pub(super) async fn change<T: Send + 'static>(
        &self,
        operation: &'static str,
        command: impl Fn(&mut Transaction<'_>) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let (rules, me) = (self.rules, self.me);
        let work = move |rows: &mut dyn Rows, effects: &mut Effects| {
            command(&mut Transaction { rows, effects, rules, me, now: None })
        };
        self.run(operation, true, work).await
    }

    pub(super) async fn read<T: Send + 'static>(
        &self,
        operation: &'static str,
        work: impl Fn(&mut dyn Rows) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        self.run(operation, false, move |rows, _| work(rows)).await
    }

    pub(super) async fn query(&self, name: &'static str, sql: &'static str, values: Vec<Value>) -> Result<Vec<Row>> {
        self.read(name, move |rows| rows.query(sql, values.clone())).await
    }

    async fn run<T: Send + 'static>(
        &self,
        operation: &'static str,
        is_change: bool,
        work: impl Fn(&mut dyn Rows, &mut Effects) -> Result<T, Abort> + Send + 'static,
    ) -> Result<T> {
        let started = Instant::now();
        let outcome = match &self.database {
            Database::Sqlite(file) if is_change => file.writer.change(work).await,
            Database::Sqlite(file) => file.read(move |rows| work(rows, &mut Effects::default())).await,
            #[cfg(feature = "postgres")]
            Database::Postgres(database) => database.run(is_change, work).await,
        };
        if let Some(observer) = &self.observer {
            // a full queue, a stale ticket and the like are answers, not failures
            let has_failed = outcome.as_ref().is_err_and(|error| matches!(error.kind.status(), 500 | 503 | 507));
            observer(operation, started.elapsed(), has_failed);
        }
        outcome
    }

    pub(super) fn file(&self) -> Option<&Sqlite> {
        match &self.database {
            Database::Sqlite(file) => Some(file),
            #[cfg(feature = "postgres")]
            Database::Postgres(_) => None,
        }
    }

    pub fn is_durable(&self) -> bool {
        self.file().is_none_or(|file| !file.place.is_temporary)
    }

    pub fn is_shared(&self) -> bool {
        self.file().is_none()
    }

    /// Writes a row without meaning, to see whether the store can write.
    pub async fn probe(&self) -> Result<()> {
        self.file().map_or(Ok(()), |file| file.place.check())?;
        let probed = self.change("probe", |change| {
            let now = change.rows.now()?;
            change.rows.write("UPDATE identity SET probed_at = $1", values![now])
        });
        probed.await
    }

    pub fn statistics(&self) -> Statistics {
        let mut statistics = *self.listeners.statistics.lock();
        // reads find damage, too
        statistics.failures += u64::from(self.file().and_then(|file| file.place.damage()).is_some());
        statistics
    }

    /// Finishes the operations under way and closes the database. Nothing works afterwards.
    pub async fn close(&self) {
        if self.is_shared()
            && let Err(error) = self.leave().await
        {
            tracing::debug!(%error, "other services take over when leases are over");
        }
        match &self.database {
            Database::Sqlite(file) => file.close().await,
            #[cfg(feature = "postgres")]
            Database::Postgres(database) => database.close(),
        }
    }
}
