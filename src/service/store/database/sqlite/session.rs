//! Statements on a connection.

use std::sync::Arc;
use std::time::SystemTime;

use rusqlite::{Connection, params_from_iter};

use super::super::{Abort, Query, Row, Rows, Value, micros, time};

fn run(connection: &Connection, sql: &str, values: &[Value]) -> rusqlite::Result<Vec<Row>> {
    // SQLite numbers `$1` by the order in which parameters appear, and `?1` by its number
    let text = sql.strip_suffix(" FOR UPDATE").unwrap_or(sql).replace('$', "?");
    let mut statement = connection.prepare_cached(&text)?;
    let names: Arc<[String]> = statement.column_names().map(ToOwned::to_owned).collect();
    let mut rows = statement.query(params_from_iter(values))?;
    let mut found = Vec::new();
    while let Some(row) = rows.next()? {
        let values = (0..names.len()).map(|place| row.get(place));
        found.push(Row { names: Arc::clone(&names), values: values.collect::<rusqlite::Result<_>>()? });
    }
    Ok(found)
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
