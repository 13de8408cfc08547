//! Statements on a connection, few at a time on the way.
//!
//! A round trip takes longer than most statements. So what a transaction begins with is sent together with its first
//! query, and changes with the next query or the commit.

use std::pin::Pin;
use std::sync::Arc;
use std::time::SystemTime;

use deadpool_postgres::Object;
use futures_util::future::{join, join_all};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::runtime::Handle;
use tokio::time::{Instant, timeout_at};
use tokio_postgres::types::{IsNull, ToSql, Type, to_sql_checked};
use tokio_postgres::{SimpleQueryMessage, Statement};
use tokio_util::bytes::{Bytes, BytesMut};

use super::super::rows::{Abort, Query, Row, Rows, Value, time};
use super::connections::{Connections, failure};

macro_rules! clock {
    ($before:literal, $after:literal) => {
        concat!($before, "SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000000 AS bigint) AS now", $after)
    };
}

const CLOCK: &str = clock!("", "");

/// A transaction begins with a look at the clock.
const BEGIN: &str = clock!("BEGIN; ", "");

/// One transaction at a time holds the lock of the queue; it then looks at the clock.
const LOCK: &str = clock!("BEGIN; ", " FROM pg_advisory_xact_lock(1953723250, 1)");

/// The same for a commit that does not wait for the disk.
const LOCK_BRIEFLY: &str =
    clock!("BEGIN; SET LOCAL synchronous_commit = off; ", " FROM pg_advisory_xact_lock(1953723250, 1)");

#[derive(Debug, Clone, Copy, PartialEq)]
enum Stage {
    /// Every statement is a transaction.
    None,
    Next(&'static str),
    Begun,
}

/// A connection, which is closed rather than used again if its transaction was broken off.
pub struct Session<'c> {
    connections: &'c Connections,
    client: Option<Object>,
    handle: Handle,
    deadline: Instant,
    stage: Stage,
    now: SystemTime,
    /// Changes that are not sent yet.
    changes: Vec<Query>,
}

impl Drop for Session<'_> {
    fn drop(&mut self) {
        if self.stage == Stage::Begun {
            self.client.take().map(Object::take);
        }
    }
}

impl<'c> Session<'c> {
    /// A session that reads, or one for a change.
    pub fn new(
        connections: &'c Connections,
        client: Object,
        handle: Handle,
        deadline: Instant,
        is_change: bool,
    ) -> Self {
        let stage = if is_change { Stage::Next(BEGIN) } else { Stage::None };
        let (client, now, changes) = (Some(client), SystemTime::UNIX_EPOCH, Vec::new());
        Self { connections, client, handle, deadline, stage, now, changes }
    }

    /// Commits, or does nothing where nothing began.
    pub fn commit(&mut self) -> Result<(), Abort> {
        if self.stage == Stage::None || (self.stage != Stage::Begun && self.changes.is_empty()) {
            return Ok(());
        }
        self.end(&[], "COMMIT", None).map(drop)
    }

    pub fn roll_back(&mut self) -> Result<(), Abort> {
        self.changes.clear();
        if self.stage == Stage::Begun {
            self.end(&[], "ROLLBACK", None)?;
        }
        Ok(())
    }

    fn end(&mut self, queries: &[Query], end: &str, last: Option<&Query>) -> Result<Vec<Vec<Row>>, Abort> {
        let found = self.send(queries, Some((end, last)))?;
        self.stage = Stage::None;
        Ok(found)
    }

    fn send(&mut self, queries: &[Query], end: Option<End<'_>>) -> Result<Vec<Vec<Row>>, Abort> {
        let changes = std::mem::take(&mut self.changes);
        let Some(client) = &self.client else {
            return Err(Abort::Broken(Error::new(Kind::Internal, "a transaction has no connection")));
        };
        let begin = match self.stage {
            Stage::Next(sql) => Some(sql),
            Stage::None | Stage::Begun => None,
        };
        if begin.is_some() {
            self.stage = Stage::Begun;
        }
        let sent = timeout_at(self.deadline, send(client, begin, &changes, queries, end));
        match self.handle.block_on(sent) {
            Ok(answer) => {
                let (now, rows) = answer?;
                self.now = now.map_or(self.now, time);
                rows.into_iter().map(read).collect()
            }
            Err(_) => Err(self.connections.too_late()),
        }
    }
}

/// How a transaction ends, and a statement after it.
type End<'e> = (&'e str, Option<&'e Query>);

type Answer = (Option<i64>, Vec<Vec<tokio_postgres::Row>>);

/// Sends statements without waiting for the answer to each.
async fn send(
    client: &Object,
    begin: Option<&str>,
    changes: &[Query],
    queries: &[Query],
    end: Option<End<'_>>,
) -> Result<Answer, Abort> {
    let mut statements = Vec::new();
    let last = end.and_then(|(_, last)| last);
    for (sql, values) in changes.iter().chain(queries).chain(last) {
        statements.push((client.prepare_cached(sql).await.map_err(failure)?, values));
    }
    let begin = async {
        match begin {
            Some(sql) => client.simple_query(sql).await,
            None => Ok(Vec::new()),
        }
    };
    let inside = changes.len() + queries.len();
    let mut requests = Vec::<Request<'_>>::new();
    for (statement, values) in &statements[..inside] {
        requests.push(Box::pin(run(client, statement, values)));
    }
    if let Some((sql, _)) = end {
        requests.push(Box::pin(async move { client.batch_execute(sql).await.map(|()| Vec::new()) }));
    }
    for (statement, values) in &statements[inside..] {
        requests.push(Box::pin(run(client, statement, values)));
    }
    // their first polls, which send the statements, are in this order
    let (begun, mut rows) = join(begin, join_all(requests)).await;
    let now = begun.map_err(failure)?.iter().rev().find_map(|message| match message {
        SimpleQueryMessage::Row(row) => row.get("now")?.parse().ok(),
        _ => None,
    });
    let after = rows.split_off(inside + usize::from(end.is_some()));
    // the first statement that failed says why
    let mut rows = rows.into_iter().collect::<Result<Vec<_>, _>>().map_err(failure)?;
    // what was committed is not to be done again
    after.into_iter().collect::<Result<Vec<_>, _>>().map_err(|error| Abort::Broken(failure(error).into_error()))?;
    rows.truncate(inside);
    Ok((now, rows.split_off(changes.len())))
}

type Request<'r> = Pin<Box<dyn Future<Output = Result<Vec<tokio_postgres::Row>, tokio_postgres::Error>> + Send + 'r>>;

async fn run(
    client: &Object,
    statement: &Statement,
    values: &[Value],
) -> Result<Vec<tokio_postgres::Row>, tokio_postgres::Error> {
    let values: Vec<&(dyn ToSql + Sync)> = values.iter().map(|value| value as _).collect();
    client.query(statement, &values).await
}

fn read(rows: Vec<tokio_postgres::Row>) -> Result<Vec<Row>, Abort> {
    let names: Arc<[String]> = rows
        .first()
        .map(|row| row.columns().iter().map(|column| column.name().to_owned()).collect())
        .unwrap_or_default();
    let row = |row: tokio_postgres::Row| {
        let values = row.columns().iter().enumerate().map(|(place, column)| value(&row, place, column.type_()));
        Ok(Row { names: Arc::clone(&names), values: values.collect::<Result<_, _>>().map_err(failure)? })
    };
    rows.into_iter().map(row).collect()
}

fn value(row: &tokio_postgres::Row, place: usize, kind: &Type) -> Result<Value, tokio_postgres::Error> {
    Ok(match *kind {
        Type::INT8 => row.try_get::<_, Option<i64>>(place)?.into(),
        Type::BOOL => row.try_get::<_, Option<bool>>(place)?.into(),
        Type::FLOAT8 => row.try_get::<_, Option<f64>>(place)?.into(),
        Type::BYTEA => row.try_get::<_, Option<Vec<u8>>>(place)?.map(Bytes::from).into(),
        _ => row.try_get::<_, Option<String>>(place)?.into(),
    })
}

impl ToSql for Value {
    fn to_sql(&self, kind: &Type, out: &mut BytesMut) -> Result<IsNull, Box<dyn std::error::Error + Sync + Send>> {
        match self {
            Self::Null => Ok(IsNull::Yes),
            Self::Integer(number) => number.to_sql(kind, out),
            Self::Real(number) => number.to_sql(kind, out),
            Self::Text(text) => text.to_sql(kind, out),
            Self::Bytes(bytes) => (&bytes[..]).to_sql(kind, out),
        }
    }

    fn accepts(_: &Type) -> bool {
        true
    }

    to_sql_checked!();
}

impl Rows for Session<'_> {
    fn all(&mut self, queries: &[Query]) -> Result<Vec<Vec<Row>>, Abort> {
        self.send(queries, None)
    }

    fn write(&mut self, sql: &'static str, values: Vec<Value>) -> Result<(), Abort> {
        self.changes.push((sql, values));
        Ok(())
    }

    /// When the transaction began.
    fn now(&mut self) -> Result<SystemTime, Abort> {
        match self.stage {
            Stage::None => return Ok(self.one(CLOCK, Vec::new())?.get("now")?),
            Stage::Next(_) => drop(self.send(&[], None)?),
            Stage::Begun => {}
        }
        Ok(self.now)
    }

    fn lock_queue(&mut self, is_brief: bool) {
        self.stage = Stage::Next(if is_brief { LOCK_BRIEFLY } else { LOCK });
    }

    fn knows_lateral(&self) -> bool {
        true
    }

    /// Both commits are in one log, so the one of `last` is on the disk only if that of the change is.
    fn conclude(&mut self, queries: &[Query], last: Query) -> Result<Vec<Vec<Row>>, Abort> {
        self.end(queries, "COMMIT", Some(&last))
    }

    fn up_since(&mut self) -> Result<SystemTime, Abort> {
        let sql = "SELECT CAST(extract(epoch FROM pg_postmaster_start_time()) * 1000000 AS bigint) AS started";
        Ok(self.one(sql, Vec::new())?.get("started")?)
    }
}
