//! The tables, and their version: the number of migrations that were run, after the first tables.
//!
//! A migration is run once, in order, and never changed after a release. There was no release yet, so there is none.

use tesserae_mesh::error::{Error, Kind, Result};

/// The first tables.
const TABLES: &str = include_str!("schema.sql");

/// Changes of the tables since the first release.
pub const MIGRATIONS: [&str; 0] = [];

/// The version of tables after these migrations.
pub fn version(migrations: &[&str]) -> i64 {
    1 + migrations.len() as i64
}

/// The statements that bring tables of a version up to date; 0 where there are none yet. Refuses a version that is not
/// known.
pub fn steps<'m>(found: i64, migrations: &[&'m str]) -> Result<Vec<&'m str>> {
    let known = version(migrations);
    if !(0..=known).contains(&found) {
        return Err(Error::new(
            Kind::Io,
            format_args!(
                "the tables of the store of jobs are of version {found}, and this version of tesserae knows them up to \
                 {known}: start the version that wrote them, or a later one"
            ),
        ));
    }
    let all: Vec<&str> = [TABLES].into_iter().chain(migrations.iter().copied()).collect();
    Ok(all.into_iter().skip(found as usize).collect())
}

/// What PostgreSQL calls the same. SQLite takes a partial index for the first of its columns only; PostgreSQL leaves a
/// comparison out that the index implies, and would then read the whole index.
#[cfg(feature = "postgres")]
const POSTGRES: [(&str, &str); 7] = [
    ("ON jobs (state, ", "ON jobs ("),
    ("INTEGER PRIMARY KEY AUTOINCREMENT", "BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY"),
    ("INTEGER", "BIGINT"),
    ("REAL", "DOUBLE PRECISION"),
    ("TEXT", "TEXT COLLATE \"C\""),
    ("BLOB", "BYTEA"),
    (" STRICT, WITHOUT ROWID;", ";"),
];

/// Statements in the dialect of PostgreSQL.
#[cfg(feature = "postgres")]
pub fn for_postgres(sql: &str) -> String {
    POSTGRES.iter().fold(sql.to_owned(), |sql, (from, to)| sql.replace(from, to)).replace(" STRICT;", ";")
}
