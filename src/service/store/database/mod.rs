//! The databases: statements in one dialect, in transactions.
//!
//! The store is written once, as functions that run statements on [`Rows`]. A statement keeps to what SQLite and
//! PostgreSQL both know: `$1` for a value, `RETURNING`, `ON CONFLICT`, and four types of [values](Value). `FOR UPDATE`
//! at its end locks the rows where transactions run side by side.

#[cfg(feature = "postgres")]
pub mod postgres;
pub mod sqlite;

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::Serialize;
use serde::de::DeserializeOwned;
use tesserae_mesh::error::{Error, Kind, Result};
use tokio_util::bytes::Bytes;
use uuid::Uuid;

use super::job::JobId;
use crate::queue::State;

pub use rusqlite::types::Value;

/// Each is run once, in order, and never changed after a release. Their number is the version of the tables.
pub const MIGRATIONS: [&str; 1] = [include_str!("../schema.sql")];

pub type Query = (&'static str, Vec<Value>);

macro_rules! values {
    ($($value:expr),* $(,)?) => { vec![$($crate::store::database::ToValue::to_value($value)),*] };
}
pub(in crate::store) use values;

/// A struct of columns that are called like its fields, and of other fields.
macro_rules! read {
    ($row:expr, $type:ident { $($column:ident),*; $($field:ident: $value:expr),* $(,)? }) => {
        $type { $($column: $row.get(stringify!($column))?,)* $($field: $value,)* }
    };
}
pub(in crate::store) use read;

#[derive(Debug)]
pub enum Abort {
    /// It is not allowed; nothing was written.
    Refused(Error),
    Broken(Error),
    /// The database broke the transaction off for the sake of another one: it may be done again.
    #[cfg(feature = "postgres")]
    Again(Error),
}

impl From<Error> for Abort {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

impl Abort {
    pub fn into_error(self) -> Error {
        match self {
            Self::Refused(error) | Self::Broken(error) => error,
            #[cfg(feature = "postgres")]
            Self::Again(error) => error,
        }
    }
}

/// A transaction, or a connection that reads.
pub trait Rows {
    /// The rows of several queries, which are sent together.
    fn all(&mut self, queries: &[Query]) -> Result<Vec<Vec<Row>>, Abort>;

    /// Changes rows: at once, or together with the next query or the commit.
    fn write(&mut self, sql: &'static str, values: Vec<Value>) -> Result<(), Abort>;

    /// Now by the clock of the database.
    fn now(&mut self) -> Result<SystemTime, Abort>;

    /// Waits until no other transaction holds the lock of the queue; to be called first. A brief lock is not held while
    /// the commit waits for the disk: a later change waits for that. A file needs no lock: one thread writes.
    fn lock_queue(&mut self, _is_brief: bool) -> Result<(), Abort> {
        Ok(())
    }

    /// When the database was started, or a time before. Leases go on while a file is not open.
    fn up_since(&mut self) -> Result<SystemTime, Abort> {
        Ok(UNIX_EPOCH)
    }

    fn query(&mut self, sql: &'static str, values: Vec<Value>) -> Result<Vec<Row>, Abort> {
        Ok(self.all(&[(sql, values)])?.pop().unwrap_or_default())
    }

    fn first(&mut self, sql: &'static str, values: Vec<Value>) -> Result<Option<Row>, Abort> {
        Ok(self.query(sql, values)?.into_iter().next())
    }

    /// The row of a query that always has one.
    fn one(&mut self, sql: &'static str, values: Vec<Value>) -> Result<Row, Abort> {
        let none = || Error::internal("the store of jobs failed: a query that gives a row gave none");
        self.first(sql, values)?.ok_or_else(|| Abort::Broken(none()))
    }
}

#[derive(Debug, Clone)]
pub struct Row {
    pub names: Arc<[String]>,
    pub values: Vec<Value>,
}

pub fn unreadable(column: &str, error: &dyn fmt::Display) -> Error {
    Error::internal(format_args!("the store of jobs cannot be read: column {column}: {error}"))
}

impl Row {
    pub fn get<T: FromValue>(&self, column: &'static str) -> Result<T> {
        let value = self.names.iter().zip(&self.values).find(|(name, _)| *name == column);
        let (_, value) = value.ok_or_else(|| unreadable(column, &"there is none"))?;
        T::from_value(value).ok_or_else(|| unreadable(column, &format_args!("{value:?}")))
    }

    /// From JSON; a column that is null is `null`.
    pub fn json<T: DeserializeOwned>(&self, column: &'static str) -> Result<T> {
        let text = self.get::<Option<String>>(column)?;
        serde_json::from_str(text.as_deref().unwrap_or("null")).map_err(|error| unreadable(column, &error))
    }
}

pub fn json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value)
        .map_err(|error| Error::internal(format_args!("what is to be stored cannot be written: {error}")))
}

/// A point in time as it is stored: microseconds since 1970.
pub fn micros(time: SystemTime) -> i64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_micros()).unwrap_or(i64::MAX)
}

pub fn time(micros: i64) -> SystemTime {
    UNIX_EPOCH + Duration::from_micros(u64::try_from(micros).unwrap_or_default())
}

pub trait ToValue {
    fn to_value(self) -> Value;
}

pub trait FromValue: Sized {
    fn from_value(value: &Value) -> Option<Self>;
}

/// Types of columns: the kind of their values, how they are written, and how they are read.
macro_rules! columns {
    ($($type:ty: $kind:ident($stored:ty), $write:expr, $read:expr;)*) => {
        $(impl ToValue for $type {
            fn to_value(self) -> Value {
                let write: fn($type) -> $stored = $write;
                Value::$kind(write(self))
            }
        }

        impl FromValue for $type {
            fn from_value(value: &Value) -> Option<Self> {
                let read: fn(&$stored) -> Option<$type> = $read;
                match value {
                    Value::$kind(value) => read(value),
                    _ => None,
                }
            }
        })*
    };
}

columns! {
    i64: Integer(i64), |number| number, |number| Some(*number);
    u64: Integer(i64), |number| number.try_into().unwrap_or(i64::MAX), |number| (*number).try_into().ok();
    usize: Integer(i64), |number| number.try_into().unwrap_or(i64::MAX), |number| (*number).try_into().ok();
    u32: Integer(i64), i64::from, |number| (*number).try_into().ok();
    i16: Integer(i64), i64::from, |number| (*number).try_into().ok();
    bool: Integer(i64), i64::from, |number| Some(*number != 0);
    SystemTime: Integer(i64), micros, |micros| Some(time(*micros));
    Duration: Integer(i64), |long| micros(UNIX_EPOCH + long), |micros| time(*micros).duration_since(UNIX_EPOCH).ok();
    f64: Real(f64), |number| number, |number| Some(*number);
    String: Text(String), |text| text, |text| Some(text.clone());
    JobId: Text(String), |id| id.to_string(), |text| text.parse().ok();
    Uuid: Text(String), |id| id.to_string(), |text| Uuid::try_parse(text).ok();
    State: Text(String), |state| state.name().to_owned(), |text| {
        State::ALL.into_iter().find(|state| state.name() == text)
    };
    Bytes: Blob(Vec<u8>), |bytes| bytes.into(), |bytes| Some(Bytes::copy_from_slice(bytes));
}

impl ToValue for &str {
    fn to_value(self) -> Value {
        Value::Text(self.to_owned())
    }
}

impl<T: ToValue> ToValue for Option<T> {
    fn to_value(self) -> Value {
        self.map_or(Value::Null, T::to_value)
    }
}

impl<T: FromValue> FromValue for Option<T> {
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Null => Some(None),
            _ => T::from_value(value).map(Some),
        }
    }
}

/// The `migrations` that tables of version `found` lack; 0 is the version of a database without tables.
pub fn steps<'m>(found: i64, migrations: &'m [&'m str]) -> Result<&'m [&'m str]> {
    usize::try_from(found).ok().and_then(|found| migrations.get(found..)).ok_or_else(|| {
        let known = migrations.len();
        let message = format_args!(
            "the tables of the store of jobs are of version {found}, and this version of tesserae knows them up to \
             {known}: start the version that wrote them, or a later one"
        );
        Error::new(Kind::Io, message)
    })
}

/// Where a store is that several services share: a URL, which nothing shows, because of its password. Every text is
/// taken here, because messages of the command line show what they refuse; the check of the settings refuses what is no
/// such URL.
#[derive(Clone, PartialEq, Eq)]
pub struct StoreUrl(pub(crate) String);

impl From<&str> for StoreUrl {
    fn from(text: &str) -> Self {
        Self(text.to_owned())
    }
}

impl fmt::Debug for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StoreUrl").finish_non_exhaustive()
    }
}
