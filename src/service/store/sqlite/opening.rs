//! Opening the file of a store: checked for damage, with the tables as they are to be, on a full disk too.

use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

use rusqlite::{Connection, OptionalExtension as _};

use super::super::cursor::Cursors;
use super::check::{self, START, is_damage};
use super::connections::{Place, Readers, lacks_room};
use super::schema::{self, MigrateError};
use crate::error::{Error, Kind, Result};

/// What a store works with.
type Opened = (Connection, Readers, Cursors);

/// Opens the file, or makes it; as a private one when the disk has no room for the files beside it.
pub(super) fn open(place: &Arc<Place>) -> Result<Opened> {
    let opened = open_up_to_date(place).or_else(|error| {
        place.set_private(is_of_room(&error));
        if !place.is_private() {
            return Err(error);
        }
        let opened = open_up_to_date(place)?;
        tracing::warn!("the disk is full; until it has room, the store of jobs cannot be copied by `tesserae backup`");
        Ok(opened)
    });
    opened.map_err(|error| match error {
        error if is_of_room(&error) => {
            cannot_open(&place.path, &"its disk is full; make room there, a few megabytes are enough")
        }
        MigrateError::Database(error) if is_damage(&error) => {
            let Error { kind, message } = error.into();
            Error::new(kind, format_args!("{message}: {}", place.path.display()))
        }
        error => cannot_open(&place.path, &error),
    })
}

/// The error of a file that cannot be opened.
pub(super) fn cannot_open(path: &Path, why: &dyn Display) -> Error {
    Error::new(Kind::Io, format_args!("the store of jobs cannot be opened: {}: {why}", path.display()))
}

fn is_of_room(error: &MigrateError) -> bool {
    matches!(error, MigrateError::Database(error) if lacks_room(error))
}

/// Opens the file, or makes it, with the tables as they are to be.
fn open_up_to_date(place: &Arc<Place>) -> Result<Opened, MigrateError> {
    let mut connection = place.writing(true)?;
    check::check(&connection, START)?;
    schema::migrate(&mut connection)?;
    if let Err(error) = schema::let_shrink(&connection) {
        tracing::warn!(%error, "the store of jobs keeps the disk space of deleted jobs for itself");
    }
    let cursors = cursors(&connection)?;
    Ok((connection, Readers::open(Arc::clone(place))?, cursors))
}

/// The cursors with the key that the file holds, or with a new one that it holds from now on.
fn cursors(connection: &Connection) -> Result<Cursors, MigrateError> {
    let sql = "SELECT cursors FROM secrets WHERE id = 1";
    let kept: Option<Vec<u8>> = connection.query_row(sql, [], |row| row.get(0)).optional()?;
    if let Some(cursors) = kept.and_then(|key| Cursors::with_key(&key)) {
        return Ok(cursors);
    }
    let cursors = Cursors::random().map_err(MigrateError::Random)?;
    connection.execute("INSERT OR REPLACE INTO secrets (id, cursors) VALUES (1, ?1)", [cursors.key()])?;
    Ok(cursors)
}
