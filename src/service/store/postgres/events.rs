//! Events of jobs.

use async_trait::async_trait;
use tokio::sync::watch;
use tokio_postgres::Row;
use tokio_postgres::types::Json;

use super::super::{Event, Events, JobId, Progress, Pulse, Ticket, What};
use super::connections::{all, first};
use super::live::Effects;
use super::replica::PostgresStore;
use super::rows::{self, Columns, column, count};
use crate::error::Result;

/// Appends the events `$3` and `$4` to those up to `$6`, where that is known.
const APPEND: &str = "WITH job AS (\
    UPDATE jobs SET last_seq = last_seq + cardinality($3::text[]), progress = $5 \
    WHERE id = $1 AND attempt = $2 AND state = 'running' AND ($6::bigint IS NULL OR last_seq = $6) \
    RETURNING number, last_seq, cancel_requested\
), told AS (\
    INSERT INTO events (job, seq, kind, data) \
    SELECT job.number, job.last_seq - cardinality($3::text[]) + e.place, e.kind, e.data \
    FROM job, unnest($3::text[], $4::text[]) WITH ORDINALITY AS e(kind, data, place)\
) SELECT last_seq, cancel_requested FROM job";

#[async_trait]
impl Events for PostgresStore {
    async fn append(&self, ticket: Ticket, events: Vec<What>, progress: Progress) -> Result<()> {
        let columns = &Columns::of(&events)?;
        let before = self.held.lock().get(&ticket).copied();
        let after = before.map(|before| before + events.len() as u64);
        let appended = self.connections.run(|client| async move {
            let (id, attempt) = (ticket.job.uuid(), ticket.attempt as i32);
            let before = before.and_then(|before| i64::try_from(before).ok());
            let row = first(&client, APPEND, &[&id, &attempt, &columns.kinds, &columns.data, &Json(progress), &before])
                .await?;
            let row = match row {
                Some(row) => Some(row),
                // the answer to the same change was lost
                None => {
                    let sql = "SELECT last_seq, cancel_requested FROM jobs \
                               WHERE id = $1 AND attempt = $2 AND state = 'running' AND last_seq = $3";
                    let after = after.and_then(|after| i64::try_from(after).ok());
                    first(&client, sql, &[&id, &attempt, &after]).await?
                }
            };
            let pulse = |row: &Row| -> Result<Pulse> {
                let (last_seq, cancel_requested) = (count(row, "last_seq")?, column(row, "cancel_requested")?);
                Ok(Pulse { last_seq, cancel_requested, ended: false })
            };
            Ok(row.as_ref().map(pulse).transpose()?)
        });
        let Some(pulse) = appended.await? else { return Err(self.over(ticket).await) };
        if let Some(last_seq) = self.held.lock().get_mut(&ticket) {
            *last_seq = pulse.last_seq;
        }
        self.follow(&Effects { pulses: vec![(ticket.job, pulse)], ..Effects::default() });
        Ok(())
    }

    async fn events(&self, id: JobId, after: u64, limit: usize) -> Result<Option<Vec<Event>>> {
        let after = i64::try_from(after).unwrap_or(i64::MAX);
        let limit = i64::try_from(limit).unwrap_or(i64::MAX);
        let found = self.connections.run(|client| async move {
            let Some(row) = first(&client, "SELECT number FROM jobs WHERE id = $1", &[&id.uuid()]).await? else {
                return Ok(None);
            };
            let number: i64 = column(&row, "number")?;
            let sql = "SELECT seq, kind, data FROM events WHERE job = $1 AND seq > $2 ORDER BY seq LIMIT $3";
            let rows = all(&client, sql, &[&number, &after, &limit]).await?;
            Ok(Some(rows.iter().map(rows::event).collect::<Result<Vec<_>>>()?))
        });
        found.await
    }

    async fn watch(&self, id: JobId) -> Result<Option<watch::Receiver<Pulse>>> {
        let receiver = self.hints.pulses.subscribe(id);
        let found = self.connections.run(|client| async move {
            let sql = "SELECT last_seq, cancel_requested, state FROM jobs WHERE id = $1";
            let row = first(&client, sql, &[&id.uuid()]).await?;
            Ok(row.as_ref().map(rows::pulse).transpose()?)
        });
        let Some(pulse) = found.await? else { return Ok(None) };
        self.hints.pulses.publish(id, pulse);
        Ok(Some(receiver))
    }
}
