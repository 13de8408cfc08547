//! SQLite: a file for one process at a time.
//!
//! One [`writer`] makes every change; reads have connections of their own and do not wait for writes. The journal is a
//! write-ahead log, and a commit returns when it is on the disk (`synchronous = FULL`): answered changes survive a
//! crash of the process, of the system, and of the power. In a temporary folder no commit waits for the disk.
//!
//! A prepared statement takes some microseconds, less than the way to another thread and back. So the writer's thread
//! runs changes, and a task reads rows itself.

mod check;
mod opening;
mod place;
mod readers;
mod session;
mod writer;

use std::path::Path;
use std::sync::Arc;

use tesserae_mesh::error::{Error, Result};

use self::place::DatabasePlace;
use self::readers::Readers;
use self::writer::Writer;
use super::super::listeners::Listeners;
use crate::ops::blocking::blocking;
use crate::ops::faults::Faults;

#[derive(Debug)]
pub struct Sqlite {
    pub readers: Readers,
    pub writer: Writer,
    place: Arc<DatabasePlace>,
}

impl Sqlite {
    /// Opens the file at `path`, or makes it. No other process may have it open. A temporary file is one that the
    /// process outlasts.
    pub async fn open(path: &Path, is_temporary: bool, listeners: Arc<Listeners>, faults: Faults) -> Result<Self> {
        let place = Arc::new(DatabasePlace::lock(path.to_owned(), is_temporary)?);
        let file = Arc::clone(&place);
        let (connection, readers) = blocking(move || opening::open(&file)).await??;
        let damage = Arc::clone(&readers.damage);
        let writer = Writer::start(connection, Arc::clone(&place), listeners, damage, faults);
        let writer = writer.map_err(|error| opening::cannot_open(&place.path, &error))?;
        Ok(Self { readers, writer, place })
    }

    pub fn is_temporary(&self) -> bool {
        self.place.is_temporary
    }

    pub fn damage(&self) -> Option<Error> {
        self.readers.damage.found()
    }

    /// Finishes the operations under way and closes the file.
    pub async fn close(&self) {
        // readers first: the last connection to close empties the log
        self.readers.close().await;
        self.writer.close().await;
        self.place.release();
    }
}
