//! Opening the file of a store: checked for damage, with the tables as they are to be.

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

/// Opens the file, or makes it, with the tables as they are to be.
pub fn open(place: &Arc<DatabasePlace>) -> Result<Opened> {
    let failed = |error| match error {
        error if lacks_room(&error) => {
            cannot_open(&place.path, &"its disk is full; make room there, a few megabytes are enough")
        }
        error if is_damage(&error) => {
            let Error { kind, message } = failure(error);
            Error::new(kind, format_args!("{message}: {}", place.path.display()))
        }
        error => cannot_open(&place.path, &message(&error)),
    };
    let mut connection = place.writing(true).map_err(failed)?;
    check::check(&mut connection, START).map_err(failed)?;
    let steps = steps(&connection, &MIGRATIONS).map_err(failed)?;
    let steps = steps.map_err(|refusal| cannot_open(&place.path, &refusal))?;
    migrate(&connection, &steps).map_err(failed)?;
    Ok((connection, Readers::open(Arc::clone(place)).map_err(failed)?))
}

/// The error of a file that cannot be opened.
pub fn cannot_open(path: &Path, why: &dyn Display) -> Error {
    Error::new(Kind::Io, format_args!("the store of jobs cannot be opened: {}: {why}", path.display()))
}

/// What brings the tables up to date. Their version stands in the head of the file.
fn steps<'m>(connection: &Connection, migrations: &[&'m str]) -> rusqlite::Result<Result<Vec<&'m str>>> {
    let found = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    Ok(schema::steps(found, migrations))
}

/// Makes the tables, or brings them up to date.
fn migrate(connection: &Connection, steps: &[&str]) -> rusqlite::Result<()> {
    if steps.is_empty() {
        return Ok(());
    }
    connection.execute_batch("BEGIN IMMEDIATE")?;
    steps.iter().try_for_each(|sql| connection.execute_batch(sql))?;
    let version: i64 = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    connection.pragma_update(None, "user_version", version + steps.len() as i64)?;
    connection.execute_batch("COMMIT")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_migration_is_run_once_and_its_version_is_kept() {
        let connection = Connection::open_in_memory().expect("it opens");
        let bring_up_to_date = |migrations: &[&'static str]| {
            let steps = steps(&connection, migrations).expect("readable");
            steps.map(|steps| migrate(&connection, &steps).expect("made"))
        };
        bring_up_to_date(&MIGRATIONS).expect("new");
        let later = ["ALTER TABLE jobs ADD COLUMN later TEXT"];
        for _ in 0..2 {
            bring_up_to_date(&later).expect("older");
            assert_eq!(connection.column_exists(None, "jobs", "later"), Ok(true));
        }
        let error = bring_up_to_date(&MIGRATIONS).expect_err("too new");
        assert!(error.message.contains("version 2,"), "{error}");
    }
}
