//! Statements on a connection. A round trip takes longer than most statements, so changes, the begin of the transaction
//! among them, are sent with the next query or the commit.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::time::SystemTime;

use futures_util::TryStreamExt as _;
use futures_util::future::join_all;
use tesserae_mesh::error::{Error, Result};
use tokio::time::Instant;
use tokio_postgres::types::{IsNull, ToSql, Type, to_sql_checked};
use tokio_postgres::{Client, Statement};
use tokio_util::bytes::{Bytes, BytesMut};

use super::super::{Abort, Query, Row, Rows, ToValue as _, Value};
use super::connections::{Connection, Connections, failure};

const CLOCK: &str = "SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000000 AS bigint) AS now";

/// A connection, which is closed rather than used again if its transaction was broken off.
pub struct Session<'c> {
    connections: &'c Connections,
    /// None after a failure.
    connection: Option<Connection>,
    deadline: Instant,
    /// Whether a transaction began that has not ended.
    is_begun: bool,
    /// Changes that are not sent yet.
    changes: Vec<Query>,
    /// Whether the clock is to be read with the next query, the first of a change: behind the locks that it waits for.
    wants_clock: bool,
    clock: Option<Row>,
}

impl Drop for Session<'_> {
    fn drop(&mut self) {
        if let Some(connection) = self.connection.take().filter(|_| !self.is_begun) {
            self.connections.put(connection);
        }
    }
}

impl<'c> Session<'c> {
    /// A session that reads: every statement is a transaction. Or one for a change.
    pub fn new(connections: &'c Connections, connection: Connection, deadline: Instant, is_change: bool) -> Self {
        let changes = if is_change { vec![("BEGIN", Vec::new())] } else { Vec::new() };
        let connection = Some(connection);
        Self { connections, connection, deadline, is_begun: false, changes, wants_clock: is_change, clock: None }
    }

    /// Ends the transaction, if there is one; a rollback sends no changes that are not sent yet.
    pub fn end(&mut self, is_commit: bool) -> Result<(), Abort> {
        let sql = if is_commit { "COMMIT" } else { "ROLLBACK" };
        if !is_commit {
            self.changes.clear();
        }
        self.wants_clock = false;
        if self.is_begun || !self.changes.is_empty() {
            self.all(&[(sql, Vec::new())])?;
            self.is_begun = false;
        }
        Ok(())
    }
}

/// Sends statements without waiting for the answer to each.
async fn send(
    client: &Client,
    prepared: &mut HashMap<&'static str, Statement>,
    queries: &[&Query],
) -> Result<Vec<Vec<Row>>, tokio_postgres::Error> {
    let mut requests = Vec::new();
    for (sql, values) in queries {
        let statement = match prepared.entry(sql) {
            Entry::Occupied(known) => known.get().clone(),
            Entry::Vacant(new) => new.insert(client.prepare(sql).await?).clone(),
        };
        requests.push(async move {
            let rows = client.query_raw(&statement, values.iter().map(Bound)).await?;
            rows.try_collect::<Vec<_>>().await
        });
    }
    // the first polls, which send the statements, are in this order; the first statement that failed says why
    join_all(requests).await.into_iter().map(|rows| read(rows?)).collect()
}

fn read(rows: Vec<tokio_postgres::Row>) -> Result<Vec<Row>, tokio_postgres::Error> {
    let columns = rows.first().map(tokio_postgres::Row::columns).unwrap_or_default();
    let names: Arc<[String]> = columns.iter().map(|column| column.name().to_owned()).collect();
    let row = |row: &tokio_postgres::Row| {
        let values = columns.iter().enumerate().map(|(place, column)| value(row, place, column.type_()));
        Ok(Row { names: Arc::clone(&names), values: values.collect::<Result<_, _>>()? })
    };
    rows.iter().map(row).collect()
}

fn value(row: &tokio_postgres::Row, place: usize, kind: &Type) -> Result<Value, tokio_postgres::Error> {
    Ok(match *kind {
        Type::INT8 => row.try_get::<_, Option<i64>>(place)?.to_value(),
        Type::BOOL => row.try_get::<_, Option<bool>>(place)?.to_value(),
        Type::FLOAT8 => row.try_get::<_, Option<f64>>(place)?.to_value(),
        Type::BYTEA => row.try_get::<_, Option<Vec<u8>>>(place)?.map(Bytes::from).to_value(),
        Type::VOID => Value::Null,
        _ => row.try_get::<_, Option<String>>(place)?.to_value(),
    })
}

#[derive(Debug)]
struct Bound<'v>(&'v Value);

impl ToSql for Bound<'_> {
    fn to_sql(&self, kind: &Type, out: &mut BytesMut) -> Result<IsNull, Box<dyn std::error::Error + Sync + Send>> {
        match self.0 {
            Value::Null => Ok(IsNull::Yes),
            Value::Integer(number) => number.to_sql(kind, out),
            Value::Real(number) => number.to_sql(kind, out),
            Value::Text(text) => text.to_sql(kind, out),
            Value::Blob(bytes) => bytes.to_sql(kind, out),
        }
    }

    fn accepts(_: &Type) -> bool {
        true
    }

    to_sql_checked!();
}

impl Rows for Session<'_> {
    fn all(&mut self, queries: &[Query]) -> Result<Vec<Vec<Row>>, Abort> {
        let changes = std::mem::take(&mut self.changes);
        let Some(connection) = &mut self.connection else {
            return Err(Abort::Broken(Error::internal("a transaction has no connection")));
        };
        self.is_begun |= !changes.is_empty();
        let clock = std::mem::take(&mut self.wants_clock).then(|| (CLOCK, Vec::new()));
        let sent: Vec<&Query> = changes.iter().chain(queries).chain(&clock).collect();
        let answer = connection.wait(self.deadline, async |client, prepared| send(client, prepared, &sent).await);
        let answer = answer.ok_or_else(|| self.connections.too_late()).and_then(|answer| answer.map_err(failure));
        let mut answer = answer.inspect_err(|_| drop(self.connection.take()))?.split_off(changes.len());
        if clock.is_some() {
            self.clock = answer.pop().and_then(|mut rows| rows.pop());
        }
        Ok(answer)
    }

    fn write(&mut self, sql: &'static str, values: Vec<Value>) -> Result<(), Abort> {
        self.changes.push((sql, values));
        Ok(())
    }

    fn now(&mut self) -> Result<SystemTime, Abort> {
        match &self.clock {
            Some(row) => Ok(row.get("now")?),
            None => Ok(self.one(CLOCK, Vec::new())?.get("now")?),
        }
    }

    fn lock_queue(&mut self, is_brief: bool) -> Result<(), Abort> {
        let brief = "SELECT set_config('synchronous_commit', 'off', true), pg_advisory_xact_lock(1953723250, 1)";
        self.write(if is_brief { brief } else { "SELECT pg_advisory_xact_lock(1953723250, 1)" }, Vec::new())
    }

    fn up_since(&mut self) -> Result<SystemTime, Abort> {
        let sql = "SELECT CAST(extract(epoch FROM pg_postmaster_start_time()) * 1000000 AS bigint) AS started";
        Ok(self.one(sql, Vec::new())?.get("started")?)
    }
}
