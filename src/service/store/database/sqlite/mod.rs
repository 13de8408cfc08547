//! SQLite: a file for one process at a time.
//!
//! One [`writer`] makes every change; reads have connections of their own and do not wait for writes. The journal is a
//! write-ahead log, and a commit returns when it is on the disk (`synchronous = FULL`): answered changes survive a
//! crash of the process, of the system, and of the power. In a temporary folder no commit waits for the disk.
//!
//! A prepared statement takes some microseconds, less than the way to another thread and back. So the writer's thread
//! runs changes, and a task reads rows itself.

mod opening;
mod place;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

use parking_lot::Mutex;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, params_from_iter};
use tesserae_mesh::error::Result;
use tokio::runtime::{Handle, RuntimeFlavor};
use tokio::sync::Semaphore;
use tokio::task::block_in_place;

use self::place::{DatabasePlace, closed, failure};
use self::writer::{Writer, WriterThread};
use super::super::listeners::Listeners;
use super::{Abort, Query, Row, Rows, Value, micros, time};
use crate::ops::faults::Faults;

/// Connections that read, at most.
const READERS: u32 = 4;

pub struct Sqlite {
    pub writer: Writer,
    pub place: Arc<DatabasePlace>,
    /// One for each connection that may read.
    readers: Semaphore,
    idle: Mutex<Vec<Connection>>,
}

impl Sqlite {
    /// Opens the file at `path`, or makes it, on this thread.
    pub fn open(path: &Path, is_temporary: bool, listeners: Arc<Listeners>, faults: Faults) -> Result<Self> {
        let place = Arc::new(DatabasePlace::lock(path.to_owned(), is_temporary)?);
        let (writing, reading) = here(|| opening::open(&place))?;
        let worker = WriterThread { connection: Some(writing), place: Arc::clone(&place), listeners, faults };
        let writer = worker.start().map_err(|error| opening::cannot_open(&place.path, &error))?;
        Ok(Self { writer, place, readers: Semaphore::new(READERS as usize), idle: Mutex::new(vec![reading]) })
    }

    /// Reads rows on this thread.
    pub async fn read<T>(&self, work: impl FnOnce(&mut dyn Rows) -> Result<T, Abort>) -> Result<T> {
        let _reader = self.readers.acquire().await.map_err(|_| closed())?;
        here(|| {
            let idle = self.idle.lock().pop();
            let mut connection = idle.map_or_else(|| self.place.reading().map_err(failure), Ok)?;
            let outcome = work(&mut connection);
            // a connection that failed is not used again
            if matches!(outcome, Ok(_) | Err(Abort::Refused(_))) {
                self.idle.lock().push(connection);
            }
            outcome.map_err(|abort| self.place.note(abort.into_error()))
        })
    }

    /// Finishes the operations under way and closes the file.
    pub async fn close(&self) {
        // readers first: the last connection to close empties the log
        let _all = self.readers.acquire_many(READERS).await;
        self.idle.lock().clear();
        self.readers.close();
        self.writer.close().await;
        self.place.release();
    }
}

/// Runs `work` on this thread. Where that takes long, the other tasks of this thread continue on another one.
fn here<T>(work: impl FnOnce() -> T) -> T {
    match Handle::current().runtime_flavor() {
        RuntimeFlavor::CurrentThread => work(),
        _ => block_in_place(work),
    }
}

/// Text that is not UTF-8, which damage leaves, is that of one row: it stops no other.
fn value(row: &rusqlite::Row<'_>, place: usize) -> rusqlite::Result<Value> {
    match row.get_ref(place)? {
        ValueRef::Text(text) => Ok(Value::Text(String::from_utf8_lossy(text).into_owned())),
        _ => row.get(place),
    }
}

fn run(connection: &Connection, sql: &str, values: &[Value]) -> rusqlite::Result<Vec<Row>> {
    // SQLite numbers `$1` by the order in which parameters appear, and `?1` by its number
    let text = sql.strip_suffix(" FOR UPDATE").unwrap_or(sql).replace('$', "?");
    let mut statement = connection.prepare_cached(&text)?;
    let names: Arc<[String]> = statement.column_names().map(ToOwned::to_owned).collect();
    let rows = statement.query_map(params_from_iter(values), |row| {
        let values = (0..names.len()).map(|place| value(row, place)).collect::<rusqlite::Result<_>>()?;
        Ok(Row { names: Arc::clone(&names), values })
    });
    rows?.collect()
}

impl Rows for Connection {
    fn all(&mut self, queries: &[Query]) -> Result<Vec<Vec<Row>>, Abort> {
        queries.iter().map(|(sql, values)| Ok(run(self, sql, values)?)).collect()
    }

    fn write(&mut self, sql: &'static str, values: Vec<Value>) -> Result<(), Abort> {
        Ok(run(self, sql, &values).map(drop)?)
    }

    /// The clock of the process, as exactly as it is stored.
    fn now(&mut self) -> Result<SystemTime, Abort> {
        Ok(time(micros(SystemTime::now())))
    }
}
