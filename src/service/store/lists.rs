//! Which jobs there are: lists, counts, and what the care of the store needs.

use std::time::SystemTime;

use tesserae_mesh::error::{Error, Result};

use super::change::{job, jobs};
use super::database::{Row, micros, values};
use super::job::JobId;
use super::store::Store;
use super::terms::{ListQuery, Page};
use crate::queue::State;

macro_rules! page {
    ($filter:literal) => {
        jobs!("WHERE (created_at, id) < ($1, $2) AND tenant = $4 " $filter "ORDER BY created_at DESC, id DESC LIMIT $3")
    };
}

/// Where a page begins that a cursor names: time and id of the last job of the page before.
fn position(cursor: &str) -> Result<(i64, String)> {
    let read = || {
        let (time, id) = cursor.split_once('-')?;
        Some((time.parse().ok()?, id.parse::<JobId>().ok()?.to_string()))
    };
    read().ok_or_else(|| Error::parameter(format_args!("cursor is not one that a list of jobs gave: {cursor:?}")))
}

impl Store {
    /// A page of jobs, newest first; [`InvalidParameter`](tesserae_mesh::Kind::InvalidParameter) for a foreign cursor.
    pub async fn list(&self, list: &ListQuery) -> Result<Page> {
        let (time, id) = list.cursor.as_deref().map_or(Ok((i64::MAX, String::new())), position)?;
        // one more than the limit, to know whether there is another page
        let mut values = values![time, id, list.limit.saturating_add(1), &*list.tenant];
        // one text a filter, so that each has its index
        let sql = match list.state {
            None => page!(""),
            Some(State::Queued) => page!("AND state = 'queued' "),
            Some(State::Running) => page!("AND state = 'running' "),
            Some(ended) => {
                values.extend(values![ended]);
                page!("AND ended_at IS NOT NULL AND state = $5 ")
            }
        };
        let mut rows = self.query("list", sql, values).await?;
        let has_more = rows.len() > list.limit;
        rows.truncate(list.limit);
        let cursor = |row: &Row| -> Result<String> {
            Ok(format!("{}-{}", micros(row.get("created_at")?), row.get::<JobId>("id")?))
        };
        let next = rows.last().filter(|_| has_more).map(cursor).transpose()?;
        // a job of a later release is left out, and the others are there
        let unread = |error: &Error| tracing::warn!(%error, "a job is left out of a list");
        Ok(Page { jobs: rows.iter().filter_map(|row| job(row).inspect_err(unread).ok()).collect(), next })
    }

    /// Whether a job was ever added to the file, deleted ones included.
    pub async fn was_used(&self) -> Result<bool> {
        let sql = "SELECT 1 FROM sqlite_sequence WHERE name = 'jobs' AND seq > 0";
        Ok(!self.query("open", sql, Vec::new()).await?.is_empty())
    }

    /// When the newest job was accepted; none when there is no job.
    pub async fn newest(&self) -> Result<Option<SystemTime>> {
        let sql = "SELECT created_at FROM jobs ORDER BY number DESC LIMIT 1";
        self.query("newest", sql, Vec::new()).await?.pop().map(|row| row.get("created_at")).transpose()
    }

    /// Number of jobs in each state, in the order of [`State::ALL`].
    pub async fn counts(&self) -> Result<[u64; State::ALL.len()]> {
        let mut counts = [0; State::ALL.len()];
        let sql = "SELECT state, count(*) AS jobs FROM jobs WHERE ended_at IS NOT NULL GROUP BY state \
            UNION ALL SELECT 'queued' AS state, count(*) AS jobs FROM jobs WHERE state = 'queued' \
            UNION ALL SELECT 'running' AS state, count(*) AS jobs FROM jobs WHERE state = 'running'";
        for row in self.query("counts", sql, Vec::new()).await? {
            counts[row.get::<State>("state")? as usize] = row.get("jobs")?;
        }
        Ok(counts)
    }

    /// When the job was accepted that waits longest; none when no job waits.
    pub async fn oldest_queued(&self) -> Result<Option<SystemTime>> {
        let sql = "SELECT min(created_at) AS oldest FROM jobs WHERE number IN \
                   (SELECT number FROM jobs WHERE state = 'queued')";
        self.read("oldest_queued", move |rows| rows.one(sql, Vec::new())).await?.get("oldest")
    }

    /// Jobs that ended so long ago, at most `limit`, the longest ended first.
    pub async fn ended_before(&self, time: SystemTime, limit: usize) -> Result<Vec<JobId>> {
        // by their age: the clock of this machine may be another than that of the store
        let age = micros(SystemTime::now()) - micros(time);
        let found = self.read("ended_before", move |rows| {
            let before = micros(rows.now()?) - age;
            let sql = "SELECT id FROM jobs WHERE ended_at < $1 ORDER BY ended_at LIMIT $2";
            rows.query(sql, values![before, limit])
        });
        found.await?.iter().map(|row| row.get("id")).collect()
    }

    /// Bytes on disk that the store has taken and will use again before it takes more.
    pub async fn free_bytes(&self) -> Result<u64> {
        if self.is_shared() {
            return Ok(0);
        }
        let sql = "SELECT freelist_count * page_size AS bytes FROM pragma_freelist_count, pragma_page_size";
        self.read("free_bytes", move |rows| rows.one(sql, Vec::new())).await?.get("bytes")
    }

    /// Gives some [free bytes](Self::free_bytes) of a file back to its disk: 4 MiB, so that no change waits for long.
    pub async fn give_back(&self) -> Result<()> {
        let given_back = self.change("give_back", |change| {
            change.rows.query("PRAGMA incremental_vacuum(1024)", Vec::new())?;
            change.effects.shrinks = true;
            Ok(())
        });
        given_back.await
    }
}
