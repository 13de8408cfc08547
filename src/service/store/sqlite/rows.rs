//! Jobs and events as rows of tables.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rusqlite::Row;
use rusqlite::types::FromSql;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::super::{Event, Job, JobId, Notice, Pulse, State, What};
use crate::error::{Error, Kind, Result};

/// A point in time as it is stored: microseconds since 1970.
pub(super) fn micros(time: SystemTime) -> i64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_micros()).unwrap_or(i64::MAX)
}

/// The point in time that is stored so.
pub(super) fn time(micros: i64) -> SystemTime {
    UNIX_EPOCH + Duration::from_micros(u64::try_from(micros).unwrap_or_default())
}

/// Now, as exactly as it is stored.
pub(super) fn now() -> SystemTime {
    time(micros(SystemTime::now()))
}

/// Something as a JSON column.
pub(super) fn json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value)
        .map_err(|error| Error::new(Kind::Internal, format_args!("what is to be stored cannot be written: {error}")))
}

/// What a JSON column holds.
pub(super) fn from_json<T: DeserializeOwned>(column: &'static str, text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|error| unreadable(column, &error))
}

fn unreadable(column: &str, error: &dyn std::fmt::Display) -> Error {
    Error::new(Kind::Internal, format_args!("the store of jobs cannot be read: column {column}: {error}"))
}

/// A column of a row.
pub(super) fn column<T: FromSql>(row: &Row<'_>, name: &'static str) -> Result<T> {
    row.get(name).map_err(|error| unreadable(name, &error))
}

/// A column of text, or none where it is null.
fn optional_text<'r>(row: &'r Row<'_>, name: &'static str) -> Result<Option<&'r str>> {
    let value = row.get_ref(name).map_err(|error| unreadable(name, &error))?;
    value.as_str_or_null().map_err(|error| unreadable(name, &error))
}

/// A column of text.
pub(super) fn text<'r>(row: &'r Row<'_>, name: &'static str) -> Result<&'r str> {
    optional_text(row, name)?.ok_or_else(|| unreadable(name, &"it is null"))
}

/// A column that counts.
pub(super) fn count(row: &Row<'_>, name: &'static str) -> Result<u64> {
    let count: i64 = column(row, name)?;
    u64::try_from(count).map_err(|error| unreadable(name, &error))
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
pub(super) fn job(row: &Row<'_>) -> Result<Job> {
    let moment = |name| -> Result<Option<SystemTime>> { Ok(column::<Option<i64>>(row, name)?.map(time)) };
    Ok(Job {
        id: id(row, "id")?,
        state: state(row)?,
        spec: from_json("spec", text(row, "spec")?)?,
        queue_position: column::<Option<i64>>(row, "queue_position")?.and_then(|place| place.try_into().ok()),
        attempt: column(row, "attempt")?,
        worker: column(row, "worker")?,
        progress: from_json("progress", text(row, "progress")?)?,
        cancel_requested: column(row, "cancel_requested")?,
        problem: optional_text(row, "problem")?.map(|text| from_json("problem", text)).transpose()?,
        summary: optional_text(row, "summary")?.map(|text| from_json("summary", text)).transpose()?,
        created_at: time(column(row, "created_at")?),
        started_at: moment("started_at")?,
        ended_at: moment("ended_at")?,
    })
}

/// The pulse of a job, from the columns `last_seq`, `cancel_requested` and `state`.
pub(super) fn pulse(row: &Row<'_>) -> Result<Pulse> {
    Ok(Pulse {
        last_seq: count(row, "last_seq")?,
        cancel_requested: column(row, "cancel_requested")?,
        ended: state(row)?.is_ended(),
    })
}

/// A notice, from a row of `notices`.
pub(super) fn notice(row: &Row<'_>) -> Result<Notice> {
    Ok(Notice {
        job: id(row, "job")?,
        webhook: column(row, "webhook")?,
        trace_parent: column(row, "trace_parent")?,
        state: state(row)?,
        problem: optional_text(row, "problem")?.map(|text| from_json("problem", text)).transpose()?,
        ended_at: time(column(row, "ended_at")?),
        end: column(row, "nth")?,
    })
}

/// A column that names a job.
pub(super) fn id(row: &Row<'_>, name: &'static str) -> Result<JobId> {
    text(row, name)?.parse().map_err(|error| unreadable(name, &error))
}

/// The column `state`.
pub(super) fn state(row: &Row<'_>) -> Result<State> {
    state_of(text(row, "state")?)
}

/// The state of that name.
fn state_of(name: &str) -> Result<State> {
    State::ALL.into_iter().find(|state| state.name() == name).ok_or_else(|| unreadable("state", &name))
}

/// What happened, as the columns `kind` and `data`.
pub(super) fn split(what: &What) -> Result<(&'static str, String)> {
    Ok(match what {
        What::State(state) => ("state", state.name().to_owned()),
        What::Started(attempt, worker) => ("started", json(&(attempt, worker))?),
        What::Iteration(row) => ("iteration", row.clone()),
        What::Round(row) => ("round", row.clone()),
        What::End(state, problem) => ("end", json(&(state, problem))?),
    })
}

/// An event, from the columns `seq`, `kind` and `data`.
pub(super) fn event(row: &Row<'_>) -> Result<Event> {
    let data = text(row, "data")?;
    let what = match text(row, "kind")? {
        "state" => What::State(state_of(data)?),
        "started" => {
            let (attempt, worker) = from_json("data", data)?;
            What::Started(attempt, worker)
        }
        "iteration" => What::Iteration(data.to_owned()),
        "round" => What::Round(data.to_owned()),
        "end" => {
            let (state, problem) = from_json("data", data)?;
            What::End(state, problem)
        }
        other => return Err(unreadable("kind", &other)),
    };
    Ok(Event { seq: count(row, "seq")?, what })
}
