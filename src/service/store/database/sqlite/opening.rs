//! Opening the file of a store: checked for damage, with the tables as they are to be, on a full disk too.

use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

use rusqlite::Connection;
use tesserae_mesh::error::{Error, Kind, Result};

use super::super::super::schema::{self, MIGRATIONS};
use super::check::{self, START, is_damage};
use super::place::{DatabasePlace, failure, lacks_room, message};
use super::readers::Readers;

/// The connection that writes, and those that read.
type Opened = (Connection, Readers);

/// Why the file cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The database failed.
    #[error("{}", message(.0))]
    Database(#[from] rusqlite::Error),
    /// Its tables are of another version.
    #[error("{0}")]
    Refused(Error),
}

/// Opens the file, or makes it; as a private one when the disk has no room for the files beside it.
pub fn open(place: &Arc<DatabasePlace>) -> Result<Opened> {
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
        OpenError::Database(error) if is_damage(&error) => {
            let Error { kind, message } = failure(error);
            Error::new(kind, format_args!("{message}: {}", place.path.display()))
        }
        error => cannot_open(&place.path, &error),
    })
}

/// The error of a file that cannot be opened.
pub fn cannot_open(path: &Path, why: &dyn Display) -> Error {
    Error::new(Kind::Io, format_args!("the store of jobs cannot be opened: {}: {why}", path.display()))
}

fn is_of_room(error: &OpenError) -> bool {
    matches!(error, OpenError::Database(error) if lacks_room(error))
}

/// Opens the file, or makes it, with the tables as they are to be.
fn open_up_to_date(place: &Arc<DatabasePlace>) -> Result<Opened, OpenError> {
    let connection = place.writing(true)?;
    check::check(&connection, START)?;
    migrate(&connection, &MIGRATIONS)?;
    Ok((connection, Readers::open(Arc::clone(place))?))
}

/// Makes the tables, or brings them up to date. Their version stands in the head of the file.
pub fn migrate(connection: &Connection, migrations: &[&str]) -> Result<(), OpenError> {
    let found = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let steps = schema::steps(found, migrations).map_err(OpenError::Refused)?;
    if steps.is_empty() {
        return Ok(());
    }
    connection.execute_batch("BEGIN IMMEDIATE")?;
    for sql in steps {
        connection.execute_batch(sql)?;
    }
    connection.pragma_update(None, "user_version", schema::version(migrations))?;
    connection.execute_batch("COMMIT").map_err(OpenError::Database)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_migration_is_run_once_and_its_version_is_kept() {
        let connection = Connection::open_in_memory().expect("it opens");
        migrate(&connection, &MIGRATIONS).expect("made");
        let later = ["ALTER TABLE jobs ADD COLUMN later TEXT"];
        for _ in 0..2 {
            migrate(&connection, &later).expect("up to date");
            assert_eq!(connection.column_exists(None, "jobs", "later"), Ok(true));
        }
        let error = migrate(&connection, &MIGRATIONS).expect_err("too new");
        assert!(error.to_string().contains("version 2,"), "{error}");
    }
}
