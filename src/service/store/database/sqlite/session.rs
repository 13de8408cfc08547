//! Statements on a connection.

use std::sync::Arc;
use std::time::SystemTime;

use rusqlite::types::{ToSqlOutput, ValueRef};
use rusqlite::{Connection, ToSql, params_from_iter};
use tokio_util::bytes::Bytes;

use super::super::{Abort, Query, Row, Rows, Value, micros, time};

fn run(connection: &Connection, sql: &str, values: &[Value]) -> rusqlite::Result<Vec<Row>> {
    // SQLite numbers `$1` by the order in which parameters appear, and `?1` by its number
    let text = sql.strip_suffix(" FOR UPDATE").unwrap_or(sql).replace('$', "?");
    let mut statement = connection.prepare_cached(&text)?;
    let names: Arc<[String]> = statement.column_names().map(ToOwned::to_owned).collect();
    let mut rows = statement.query(params_from_iter(values))?;
    let mut found = Vec::new();
    while let Some(row) = rows.next()? {
        let values = (0..names.len()).map(|place| row.get_ref(place).map(Value::from));
        found.push(Row { names: Arc::clone(&names), values: values.collect::<rusqlite::Result<_>>()? });
    }
    Ok(found)
}

impl From<ValueRef<'_>> for Value {
    fn from(value: ValueRef<'_>) -> Self {
        match value {
            ValueRef::Null => Self::Null,
            ValueRef::Integer(number) => Self::Integer(number),
            ValueRef::Real(number) => Self::Real(number),
            ValueRef::Text(text) => Self::Text(String::from_utf8_lossy(text).into_owned()),
            ValueRef::Blob(bytes) => Self::Bytes(Bytes::copy_from_slice(bytes)),
        }
    }
}

impl ToSql for Value {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        Ok(ToSqlOutput::Borrowed(match self {
            Self::Null => ValueRef::Null,
            Self::Integer(number) => ValueRef::Integer(*number),
            Self::Real(number) => ValueRef::Real(*number),
            Self::Text(text) => ValueRef::Text(text.as_bytes()),
            Self::Bytes(bytes) => ValueRef::Blob(bytes),
        }))
    }
}

impl Rows for Connection {
    fn all(&mut self, queries: &[Query]) -> Result<Vec<Vec<Row>>, Abort> {
        queries.iter().map(|(sql, values)| Ok(run(self, sql, values)?)).collect()
    }

    fn write(&mut self, sql: &'static str, values: Vec<Value>) -> Result<(), Abort> {
        Ok(run(self, sql, &values).map(drop)?)
    }

    /// The clock of the process, as exactly as it is stored.
    fn now(&mut self) -> Result<SystemTime, Abort> {
        Ok(time(micros(SystemTime::now())))
    }

    /// One thread writes.
    fn lock_queue(&mut self, _is_brief: bool) -> Result<(), Abort> {
        Ok(())
    }

    /// Leases go on while the file is not open.
    fn up_since(&mut self) -> Result<SystemTime, Abort> {
        Ok(SystemTime::UNIX_EPOCH)
    }
}
