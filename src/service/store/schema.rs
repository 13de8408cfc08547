//! The tables, and their version: the number of migrations that were run.

use tesserae_mesh::error::{Error, Kind, Result};

/// Each is run once, in order, and never changed after a release.
pub const MIGRATIONS: [&str; 1] = [include_str!("schema.sql")];

/// Those of `migrations` that bring tables of a version up to date: 0 where there are none yet.
pub fn steps<'m>(found: i64, migrations: &'m [&'m str]) -> Result<&'m [&'m str]> {
    usize::try_from(found).ok().and_then(|found| migrations.get(found..)).ok_or_else(|| {
        let known = migrations.len();
        Error::new(
            Kind::Io,
            format_args!(
                "the tables of the store of jobs are of version {found}, and this version of tesserae knows them up to \
                 {known}: start the version that wrote them, or a later one"
            ),
        )
    })
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
