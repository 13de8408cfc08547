//! Rows and values, as both databases know them.

use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::Serialize;
use serde::de::DeserializeOwned;
use tesserae_mesh::error::{Error, Kind, Result};
use tokio_util::bytes::Bytes;
use uuid::Uuid;

use super::super::job::JobId;
use crate::queue::State;

#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    Null,
    Integer(i64),
    Real(f64),
    Text(String),
    Bytes(Bytes),
}

pub type Query = (&'static str, Vec<Value>);

macro_rules! values {
    ($($value:expr),* $(,)?) => { vec![$($crate::store::database::rows::Value::from($value)),*] };
}
pub(in crate::store) use values;

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
    /// the commit waits for the disk: the change ends with [`conclude`](Self::conclude).
    fn lock_queue(&mut self, is_brief: bool);

    /// The rows of the last queries of a change, which is committed. Then `last` runs: once it is on the disk, so is
    /// the change.
    fn conclude(&mut self, queries: &[Query], last: Query) -> Result<Vec<Vec<Row>>, Abort>;

    /// Whether a query in `FROM` may name rows beside it.
    fn knows_lateral(&self) -> bool;

    /// When the database was started, or a time before.
    fn up_since(&mut self) -> Result<SystemTime, Abort>;

    fn query(&mut self, sql: &'static str, values: Vec<Value>) -> Result<Vec<Row>, Abort> {
        Ok(self.all(&[(sql, values)])?.pop().unwrap_or_default())
    }

    fn first(&mut self, sql: &'static str, values: Vec<Value>) -> Result<Option<Row>, Abort> {
        Ok(self.query(sql, values)?.into_iter().next())
    }

    /// The row of a query that always has one.
    fn one(&mut self, sql: &'static str, values: Vec<Value>) -> Result<Row, Abort> {
        let none = || Error::new(Kind::Internal, "the store of jobs failed: a query that gives a row gave none");
        self.first(sql, values)?.ok_or_else(|| Abort::Broken(none()))
    }
}

#[derive(Debug, Clone)]
pub struct Row {
    pub names: Arc<[String]>,
    pub values: Vec<Value>,
}

fn unreadable(column: &str, error: &dyn std::fmt::Display) -> Error {
    Error::new(Kind::Internal, format_args!("the store of jobs cannot be read: column {column}: {error}"))
}

impl Row {
    fn value(&self, column: &'static str) -> Result<&Value> {
        let place = self.names.iter().position(|name| name == column);
        place.and_then(|place| self.values.get(place)).ok_or_else(|| unreadable(column, &"there is none"))
    }

    pub fn get<T: FromValue>(&self, column: &'static str) -> Result<T> {
        let value = self.value(column)?;
        T::from_value(value).ok_or_else(|| unreadable(column, &format_args!("{value:?}")))
    }

    pub fn text(&self, column: &'static str) -> Result<&str> {
        match self.value(column)? {
            Value::Text(text) => Ok(text),
            value => Err(unreadable(column, &format_args!("{value:?}"))),
        }
    }

    pub fn json<T: DeserializeOwned>(&self, column: &'static str) -> Result<T> {
        serde_json::from_str(self.text(column)?).map_err(|error| unreadable(column, &error))
    }

    pub fn optional_json<T: DeserializeOwned>(&self, column: &'static str) -> Result<Option<T>> {
        match self.value(column)? {
            Value::Null => Ok(None),
            _ => self.json(column).map(Some),
        }
    }
}

pub fn json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value)
        .map_err(|error| Error::new(Kind::Internal, format_args!("what is to be stored cannot be written: {error}")))
}

/// A point in time as it is stored: microseconds since 1970.
pub fn micros(time: SystemTime) -> i64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_micros()).unwrap_or(i64::MAX)
}

pub fn time(micros: i64) -> SystemTime {
    UNIX_EPOCH + Duration::from_micros(u64::try_from(micros).unwrap_or_default())
}

pub trait FromValue: Sized {
    fn from_value(value: &Value) -> Option<Self>;
}

/// Types, and the kinds of values that they are read from.
macro_rules! read_as {
    ($($type:ty: $kind:ident($value:ident) => $read:expr;)*) => {
        $(impl FromValue for $type {
            fn from_value(value: &Value) -> Option<Self> {
                match value {
                    Value::$kind($value) => $read,
                    _ => None,
                }
            }
        })*
    };
}

read_as! {
    i64: Integer(number) => Some(*number);
    u64: Integer(number) => (*number).try_into().ok();
    u32: Integer(number) => (*number).try_into().ok();
    i16: Integer(number) => (*number).try_into().ok();
    bool: Integer(number) => Some(*number != 0);
    SystemTime: Integer(micros) => Some(time(*micros));
    f64: Real(number) => Some(*number);
    String: Text(text) => Some(text.clone());
    JobId: Text(text) => text.parse().ok();
    Uuid: Text(text) => Uuid::try_parse(text).ok();
    State: Text(text) => State::ALL.into_iter().find(|state| state.name() == text);
    Bytes: Bytes(bytes) => Some(bytes.clone());
}

impl<T: FromValue> FromValue for Option<T> {
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Null => Some(None),
            _ => T::from_value(value).map(Some),
        }
    }
}

macro_rules! write_as {
    ($($type:ty: $write:expr;)*) => {
        $(impl From<$type> for Value {
            fn from(value: $type) -> Self {
                let write: fn($type) -> Self = $write;
                write(value)
            }
        })*
    };
}

write_as! {
    i64: Self::Integer;
    u64: |number| Self::Integer(number.try_into().unwrap_or(i64::MAX));
    usize: |number| Self::Integer(number.try_into().unwrap_or(i64::MAX));
    u32: |number| Self::Integer(number.into());
    i16: |number| Self::Integer(number.into());
    bool: |is_so| Self::Integer(is_so.into());
    f64: Self::Real;
    String: Self::Text;
    &str: |text| Self::Text(text.to_owned());
    Bytes: Self::Bytes;
    SystemTime: |time| Self::Integer(micros(time));
    Duration: |time| Self::Integer(time.as_micros().try_into().unwrap_or(i64::MAX));
    JobId: |id| Self::Text(id.to_string());
    Uuid: |id| Self::Text(id.to_string());
    State: |state| Self::Text(state.name().to_owned());
}

impl<T: Into<Value>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Null, Into::into)
    }
}
