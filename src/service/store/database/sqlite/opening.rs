//! Opening the file of a store: checked for damage, with the tables as they are to be.

use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

use rusqlite::Connection;
use tesserae_mesh::error::{Error, Kind, Result};

use super::super::super::schema::{self, MIGRATIONS};
use super::check::{self, is_damage};
use super::place::{DatabasePlace, failure, lacks_room, message};
use super::readers::Readers;

/// The connection that writes, and those that read.
pub fn open(place: &Arc<DatabasePlace>) -> Result<(Connection, Readers)> {
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
    let mut connection = place.writing().map_err(failed)?;
    check::check(&mut connection).map_err(failed)?;
    let migrated = migrate(&connection, &MIGRATIONS).map_err(failed)?;
    migrated.map_err(|refusal| cannot_open(&place.path, &refusal))?;
    Ok((connection, Readers::open(Arc::clone(place)).map_err(failed)?))
}

pub fn cannot_open(path: &Path, why: &dyn Display) -> Error {
    Error::new(Kind::Io, format_args!("the store of jobs cannot be opened: {}: {why}", path.display()))
}

/// Makes the tables, or brings them up to date. Their version stands in the head of the file.
fn migrate(connection: &Connection, migrations: &[&str]) -> rusqlite::Result<Result<()>> {
    let version = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let steps = match schema::steps(version, migrations) {
        Ok([]) => return Ok(Ok(())),
        Ok(steps) => steps,
        Err(refusal) => return Ok(Err(refusal)),
    };
    connection.execute_batch("BEGIN IMMEDIATE")?;
    steps.iter().try_for_each(|sql| connection.execute_batch(sql))?;
    connection.pragma_update(None, "user_version", migrations.len() as i64)?;
    connection.execute_batch("COMMIT").map(Ok)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_migration_is_run_once_and_its_version_is_kept() {
        let connection = Connection::open_in_memory().expect("it opens");
        let bring_up_to_date = |migrations: &[&str]| migrate(&connection, migrations).expect("made");
        bring_up_to_date(&MIGRATIONS).expect("new");
        let later = [MIGRATIONS[0], "ALTER TABLE jobs ADD COLUMN later TEXT"];
        for _ in 0..2 {
            bring_up_to_date(&later).expect("older");
            assert_eq!(connection.column_exists(None, "jobs", "later"), Ok(true));
        }
        let error = bring_up_to_date(&MIGRATIONS).expect_err("too new");
        assert!(error.message.contains("version 2,"), "{error}");
    }
}
