//! A failed job waits again, by request.

use rusqlite::Row;

use super::super::{ALONE_FROM, JobId, Retried, Rules, State};
use super::commands::{LIVE, Live, check_queue, find};
use super::connections::{Abort, execute, first};
use super::rows;
use super::writer::{Batch, Command};

/// Runs a failed job again.
pub(super) struct Retry(pub JobId, pub Rules);

impl Command for Retry {
    type Output = Retried;

    fn apply(&self, batch: &mut Batch<'_>) -> Result<Retried, Abort> {
        let Self(id, rules) = self;
        let read = |row: &Row<'_>| Ok((rows::state(row)?, Live::from_row(*id, row)?));
        let Some((state, mut live)) = first(batch.connection, LIVE, [id.to_string()], read)? else {
            return Ok(Retried::Unknown);
        };
        if state != State::Failed {
            return Ok(Retried::NotFailed(state));
        }
        check_queue(batch.connection, rules)?;
        let sql = "UPDATE jobs SET problem = NULL, ended_at = NULL, cancel_requested = 0 WHERE number = ?1";
        execute(batch.connection, sql, [live.number])?;
        live.cancel_requested = false;
        live.uncounted = live.attempt;
        // what may kill the process still starts alone, but at once
        live.suspicion = live.suspicion.min(ALONE_FROM);
        live.queue(batch, rows::now())?;
        Ok(find(batch.connection, *id)?.map_or(Retried::Unknown, |job| Retried::Queued(Box::new(job))))
    }
}
