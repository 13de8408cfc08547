//! Jobs and events as rows of tables.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::Serialize;
use serde::de::DeserializeOwned;
use sqlx::Row as _;
use sqlx::sqlite::SqliteRow;

use super::super::{Event, Job, Notice, State, What};
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
fn from_json<T: DeserializeOwned>(column: &'static str, text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|error| unreadable(column, &error))
}

fn unreadable(column: &str, error: &dyn std::fmt::Display) -> Error {
    Error::new(Kind::Internal, format_args!("the store of jobs cannot be read: column {column}: {error}"))
}

/// A column of a row.
pub(super) fn column<'r, T>(row: &'r SqliteRow, name: &'static str) -> Result<T>
where
    T: sqlx::Decode<'r, sqlx::Sqlite> + sqlx::Type<sqlx::Sqlite>,
{
    row.try_get(name).map_err(|error| unreadable(name, &error))
}

/// A column that counts.
pub(super) fn count(row: &SqliteRow, name: &'static str) -> Result<u64> {
    let count: i64 = column(row, name)?;
    u64::try_from(count).map_err(|error| unreadable(name, &error))
}

/// What `SELECT` needs to say for [`job`]: all columns, and the place in the queue.
macro_rules! jobs {
    ($rest:literal) => {
        concat!(
            "SELECT *, CASE state WHEN 'queued' THEN (SELECT count(*) FROM jobs AS before WHERE before.state = 'queued' \
             AND before.number <= jobs.number) END AS queue_position FROM jobs ",
            $rest
        )
    };
}
pub(super) use jobs;

/// A job, from a row that [`jobs!`] selected.
pub(super) fn job(row: &SqliteRow) -> Result<Job> {
    let optional = |name| -> Result<Option<&str>> { column(row, name) };
    let moment = |name| -> Result<Option<SystemTime>> { Ok(column::<Option<i64>>(row, name)?.map(time)) };
    let id: &str = column(row, "id")?;
    let state: &str = column(row, "state")?;
    Ok(Job {
        id: id.parse().map_err(|error| unreadable("id", &error))?,
        state: state_of(state)?,
        spec: from_json("spec", column(row, "spec")?)?,
        queue_position: column::<Option<i64>>(row, "queue_position")?.and_then(|place| place.try_into().ok()),
        attempt: attempt(row)?,
        progress: from_json("progress", column(row, "progress")?)?,
        cancel_requested: column(row, "cancel_requested")?,
        problem: optional("problem")?.map(|text| from_json("problem", text)).transpose()?,
        summary: optional("summary")?.map(|text| from_json("summary", text)).transpose()?,
        created_at: time(column(row, "created_at")?),
        started_at: moment("started_at")?,
        ended_at: moment("ended_at")?,
    })
}

/// What is to be told, from a row of `notices`.
pub(super) fn notice(row: &SqliteRow) -> Result<Notice> {
    let problem: Option<&str> = column(row, "problem")?;
    Ok(Notice {
        job: column::<&str>(row, "job")?.parse().map_err(|error| unreadable("job", &error))?,
        webhook: column(row, "webhook")?,
        trace_parent: column(row, "trace_parent")?,
        state: state_of(column(row, "state")?)?,
        problem: problem.map(|text| from_json("problem", text)).transpose()?,
        ended_at: time(column(row, "ended_at")?),
    })
}

/// The column `attempt`.
pub(super) fn attempt(row: &SqliteRow) -> Result<u32> {
    u32::try_from(count(row, "attempt")?).map_err(|error| unreadable("attempt", &error))
}

/// The state of that name.
pub(super) fn state_of(name: &str) -> Result<State> {
    State::ALL.into_iter().find(|state| state.name() == name).ok_or_else(|| unreadable("state", &name))
}

/// What happened, as the columns `kind` and `data`.
pub(super) fn split(what: &What) -> Result<(&'static str, String)> {
    Ok(match what {
        What::State(state) => ("state", state.name().to_owned()),
        What::Iteration(row) => ("iteration", row.clone()),
        What::Round(row) => ("round", row.clone()),
        What::End(state, problem) => ("end", json(&(state, problem))?),
    })
}

/// An event, from the columns `seq`, `kind` and `data`.
pub(super) fn event(row: &SqliteRow) -> Result<Event> {
    let kind: &str = column(row, "kind")?;
    let data: &str = column(row, "data")?;
    let what = match kind {
        "state" => What::State(state_of(data)?),
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
