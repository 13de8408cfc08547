//! Jobs, events and notices as rows of tables.

use std::time::SystemTime;

use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio_postgres::Row;
use tokio_postgres::types::{FromSql, Json};
use uuid::Uuid;

use super::super::{Event, Job, JobId, Notice, Pulse, State, What};
use crate::error::{Error, Kind, Result};

fn unreadable(column: &str, error: &dyn std::fmt::Display) -> Error {
    Error::new(Kind::Internal, format_args!("the store of jobs cannot be read: column {column}: {error}"))
}

/// A column of a row.
pub(super) fn column<'r, T: FromSql<'r>>(row: &'r Row, name: &'static str) -> Result<T> {
    row.try_get(name).map_err(|error| unreadable(name, &error))
}

/// A column that counts.
pub(super) fn count(row: &Row, name: &'static str) -> Result<u64> {
    let count: i64 = column(row, name)?;
    u64::try_from(count).map_err(|error| unreadable(name, &error))
}

/// A column that counts few.
pub(super) fn small(row: &Row, name: &'static str) -> Result<u32> {
    let count: i32 = column(row, name)?;
    u32::try_from(count).map_err(|error| unreadable(name, &error))
}

/// A JSON column, or none where it is null.
fn optional_json<T: DeserializeOwned>(row: &Row, name: &'static str) -> Result<Option<T>> {
    Ok(column::<Option<Json<T>>>(row, name)?.map(|Json(value)| value))
}

/// A JSON column.
pub(super) fn json<T: DeserializeOwned>(row: &Row, name: &'static str) -> Result<T> {
    optional_json(row, name)?.ok_or_else(|| unreadable(name, &"it is null"))
}

/// A `SELECT` for [`job`]: all columns, and the place in the tenant's queue.
macro_rules! jobs {
    ($rest:literal) => {
        concat!(
            "SELECT *, CASE state WHEN 'queued' THEN (SELECT count(*) FROM jobs AS before \
             WHERE before.state = 'queued' AND before.tenant = jobs.tenant \
             AND (before.urgency, before.number) <= (jobs.urgency, jobs.number)) END AS queue_position FROM jobs ",
            $rest
        )
    };
}
pub(super) use jobs;

/// A job, from a row that [`jobs!`] selected.
pub(super) fn job(row: &Row) -> Result<Job> {
    let queue_position = column::<Option<i64>>(row, "queue_position")?.and_then(|place| place.try_into().ok());
    Ok(Job { queue_position, ..unplaced(row)? })
}

/// A job without its place in the queue.
pub(super) fn unplaced(row: &Row) -> Result<Job> {
    Ok(Job {
        id: id(row, "id")?,
        state: state(row)?,
        spec: json(row, "spec")?,
        queue_position: None,
        attempt: small(row, "attempt")?,
        worker: column(row, "worker")?,
        progress: json(row, "progress")?,
        cancel_requested: column(row, "cancel_requested")?,
        problem: optional_json(row, "problem")?,
        summary: optional_json(row, "summary")?,
        created_at: column(row, "created_at")?,
        started_at: column::<Option<SystemTime>>(row, "started_at")?,
        ended_at: column::<Option<SystemTime>>(row, "ended_at")?,
    })
}

/// The pulse of a job, from the columns `last_seq`, `cancel_requested` and `state`.
pub(super) fn pulse(row: &Row) -> Result<Pulse> {
    Ok(Pulse {
        last_seq: count(row, "last_seq")?,
        cancel_requested: column(row, "cancel_requested")?,
        ended: state(row)?.is_ended(),
    })
}

/// A notice, from a row of `notices`.
pub(super) fn notice(row: &Row) -> Result<Notice> {
    Ok(Notice {
        job: id(row, "job")?,
        webhook: column(row, "webhook")?,
        trace_parent: column(row, "trace_parent")?,
        state: state(row)?,
        problem: optional_json(row, "problem")?,
        ended_at: column(row, "ended_at")?,
        end: small(row, "nth")?,
    })
}

/// A column that names a job.
pub(super) fn id(row: &Row, name: &'static str) -> Result<JobId> {
    Ok(JobId::from_uuid(column::<Uuid>(row, name)?))
}

/// The column `state`.
pub(super) fn state(row: &Row) -> Result<State> {
    state_of(column(row, "state")?)
}

/// The state of that name.
fn state_of(name: &str) -> Result<State> {
    State::ALL.into_iter().find(|state| state.name() == name).ok_or_else(|| unreadable("state", &name))
}

/// Events as columns of equal length.
#[derive(Debug, Default)]
pub(super) struct Columns {
    pub kinds: Vec<&'static str>,
    pub data: Vec<String>,
}

impl Columns {
    /// The columns of some events.
    pub fn of<'e>(events: impl IntoIterator<Item = &'e What>) -> Result<Self> {
        let mut columns = Self::default();
        for event in events {
            let (kind, data) = split(event)?;
            columns.kinds.push(kind);
            columns.data.push(data);
        }
        Ok(columns)
    }
}

/// What happened, as the columns `kind` and `data`.
fn split(what: &What) -> Result<(&'static str, String)> {
    fn text<T: Serialize>(value: &T) -> Result<String> {
        serde_json::to_string(value)
            .map_err(|error| Error::new(Kind::Internal, format_args!("an event cannot be written: {error}")))
    }
    Ok(match what {
        What::State(state) => ("state", state.name().to_owned()),
        What::Started(attempt, worker) => ("started", text(&(attempt, worker))?),
        What::Iteration(row) => ("iteration", row.clone()),
        What::Round(row) => ("round", row.clone()),
        What::End(state, problem) => ("end", text(&(state, problem))?),
    })
}

/// An event, from the columns `seq`, `kind` and `data`.
pub(super) fn event(row: &Row) -> Result<Event> {
    fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
        serde_json::from_str(text).map_err(|error| unreadable("data", &error))
    }
    let data: &str = column(row, "data")?;
    let what = match column(row, "kind")? {
        "state" => What::State(state_of(data)?),
        "started" => {
            let (attempt, worker) = parse(data)?;
            What::Started(attempt, worker)
        }
        "iteration" => What::Iteration(data.to_owned()),
        "round" => What::Round(data.to_owned()),
        "end" => {
            let (state, problem) = parse(data)?;
            What::End(state, problem)
        }
        other => return Err(unreadable("kind", &other)),
    };
    Ok(Event { seq: count(row, "seq")?, what })
}
