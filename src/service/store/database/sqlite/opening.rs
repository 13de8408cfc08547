//! Opening the file of a store: checked for damage, with the tables as they are to be.

use std::fmt::Display;
use std::path::Path;
use std::time::{Duration, Instant};

use rusqlite::{Connection, ErrorCode};
use tesserae_mesh::error::{Error, Kind, Result};

use super::super::{MIGRATIONS, steps};
use super::place::{DatabasePlace, failure, is_damage, lacks_room, message};

/// Longest time that the check may take when the store is opened. 300,000 jobs in 0.9 GB took 8 s on a busy machine.
const LONGEST: Duration = Duration::from_secs(10);

/// A connection that writes, and one that reads.
pub fn open(place: &DatabasePlace) -> Result<(Connection, Connection)> {
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
    if !place.is_temporary {
        check(&mut connection).map_err(failed)?;
    }
    let migrated = migrate(&connection, &MIGRATIONS).map_err(failed)?;
    migrated.map_err(|refusal| cannot_open(&place.path, &refusal))?;
    Ok((connection, place.reading().map_err(failed)?))
}

pub fn cannot_open(path: &Path, why: &dyn Display) -> Error {
    Error::new(Kind::Io, format_args!("the store of jobs cannot be opened: {}: {why}", path.display()))
}

/// Checks the structure of all tables and indices.
fn check(connection: &mut Connection) -> rusqlite::Result<()> {
    let started = Instant::now();
    // a look at the time after so many operations of SQLite, of which reading a page is one
    connection.progress_handler(1_000, Some(move || started.elapsed() > LONGEST))?;
    let found = connection.query_row("PRAGMA quick_check(1)", [], |row| row.get::<_, String>(0));
    connection.progress_handler(0, None::<fn() -> bool>)?;
    match found {
        Ok(verdict) if verdict == "ok" => {
            tracing::debug!(milliseconds = started.elapsed().as_millis() as u64, "the store of jobs is sound");
            Ok(())
        }
        Ok(verdict) => {
            let code = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT);
            Err(rusqlite::Error::SqliteFailure(code, Some(verdict.replace('\n', " "))))
        }
        Err(error) if error.sqlite_error_code() == Some(ErrorCode::OperationInterrupted) => {
            let seconds = LONGEST.as_secs();
            tracing::warn!(seconds, "the store of jobs is so large that only a part of it was checked for damage");
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// Makes the tables, or brings them up to date. Their version stands in the head of the file.
fn migrate(connection: &Connection, migrations: &[&str]) -> rusqlite::Result<Result<()>> {
    let version = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let steps = match steps(version, migrations) {
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
    }
}
