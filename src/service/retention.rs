//! Retention: deletes jobs some time after their end, with their results, and sweeps files that belong to no job.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use futures_util::future::join_all;
use tokio_util::sync::CancellationToken;

use super::aging::{self, Aging, Reading};
use super::deletion;
use super::files::Files;
use super::store::{Deletion, JobStore, ListQuery};
use crate::error::Result;

/// Jobs that are deleted at a time.
const AT_ONCE: usize = 100;

/// Longest time between two looks for expired jobs.
const INTERVAL: Duration = Duration::from_secs(30);

/// Time between two sweeps of files that a failed removal left.
const SWEEP: Duration = Duration::from_secs(3600);

/// Time from the start to the first sweep: a service that is started again every hour would never sweep otherwise.
const FIRST_SWEEP: Duration = Duration::from_secs(5);

/// Deletes jobs some time after their end.
#[derive(Debug)]
pub(super) struct Retention {
    files: Arc<Files>,
    store: Arc<dyn JobStore>,
    /// Time for which an ended job is kept; for ever when none.
    kept: Option<Duration>,
    aging: Aging,
    /// The file with the time that was reached.
    clock: Option<PathBuf>,
}

impl Retention {
    /// For the jobs of a store, from `now` on. Without a file, the time reached is the creation of the newest job: a
    /// clock that jumped since then must not expire it.
    pub async fn new(
        files: Arc<Files>,
        store: Arc<dyn JobStore>,
        kept: Option<Duration>,
        now: Reading,
    ) -> Result<Self> {
        let clock = files.clock();
        let reached = match clock.as_deref().and_then(aging::load) {
            None => store
                .list(&ListQuery { limit: 1, ..ListQuery::default() })
                .await?
                .jobs
                .first()
                .map(|job| job.created_at),
            reached => reached,
        };
        let retention = Self { files, store, kept, aging: Aging::new(reached, now), clock };
        retention.save();
        Ok(retention)
    }

    /// Writes the time that was reached to its file.
    fn save(&self) {
        if let Some(clock) = &self.clock
            && let Err(error) = aging::save(clock, self.aging.reached())
        {
            tracing::debug!(%error, "the time cannot be kept");
        }
    }

    /// Deletes expired jobs until `stop`.
    pub async fn run(mut self, stop: CancellationToken) {
        let kept = self.kept;
        let interval = kept.map_or(INTERVAL, |kept| (kept / 10).clamp(Duration::from_millis(100), INTERVAL));
        let (mut swept, mut pause) = (Instant::now(), FIRST_SWEEP);
        loop {
            tokio::select! {
                () = stop.cancelled() => return self.save(),
                () = tokio::time::sleep(interval) => {}
            }
            // one service does it for all that share the store
            if !self.store.may_clean_up().await.unwrap_or(false) {
                continue;
            }
            let time = self.look(Reading::now()).await;
            if swept.elapsed() >= pause {
                (swept, pause) = (Instant::now(), SWEEP);
                match self.files.sweep(self.store.as_ref()).await {
                    Ok(removed) => tracing::debug!(removed, "swept"),
                    Err(error) => tracing::warn!(%error, "the data folder cannot be swept now"),
                }
                if let Err(error) = self.files.empty_aside(time).await {
                    tracing::warn!(%error, "what was moved aside cannot be removed now");
                }
            }
        }
    }

    /// Deletes the jobs that have expired; the time by which they did.
    async fn look(&mut self, now: Reading) -> SystemTime {
        let time = self.aging.time(now);
        self.save();
        let before = self.kept.and_then(|kept| time.checked_sub(kept));
        if let Some(before) = before
            && let Err(error) = self.expire(before).await
        {
            tracing::warn!(%error, "expired jobs cannot be deleted now");
        }
        time
    }

    /// Deletes every job that ended before a moment.
    async fn expire(&self, before: SystemTime) -> Result<()> {
        loop {
            let old = self.store.ended_before(before, AT_ONCE).await?;
            // at once: they share a transaction, as many jobs may end as begin
            let outcomes = join_all(old.iter().map(async |id| {
                let outcome = deletion::delete(&self.files, self.store.as_ref(), *id).await?;
                if outcome == Deletion::Deleted {
                    tracing::info!(job = %id, "forgotten");
                }
                Result::Ok(())
            }));
            outcomes.await.into_iter().collect::<Result<()>>()?;
            if old.len() < AT_ONCE {
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::faults::Faults;
    use crate::service::files::DiskLimits;
    use crate::service::store::tests::{new_job, store_in};
    use crate::service::store::{End, Queue};

    #[tokio::test]
    async fn a_clock_that_jumps_forward_makes_no_job_expire() {
        let folder = tempfile::tempdir().expect("a folder");
        let open = || {
            let opened = Files::open(Some(folder.path()), None, DiskLimits::default(), Faults::default());
            Arc::new(opened.expect("it opens"))
        };
        let week = Duration::from_secs(7 * 86_400);
        let store = Arc::new(store_in(folder.path()).await);
        store.create(new_job()).await.expect("created");
        let claimed = store.claim(1, week).await.expect("claimable");
        store.finish(claimed[0].0, End::Cancelled).await.expect("ended");
        let is_there = async || store.get(claimed[0].0.job).await.expect("readable").is_some();

        let start = Reading::now();
        let at = |wall: Duration, steady: Duration| Reading { wall: start.wall + wall, steady: start.steady + steady };
        let minute = Duration::from_secs(60);
        let from = async |files: &Arc<Files>, now| {
            let jobs = Arc::clone(&store) as Arc<dyn JobStore>;
            Retention::new(Arc::clone(files), jobs, Some(week), now).await.expect("readable")
        };
        let files = open();
        from(&files, at(2 * week, Duration::ZERO)).await.look(at(2 * week + minute, minute)).await;
        assert!(is_there().await, "it jumped before the first start that keeps the time");
        std::fs::remove_file(files.clock().expect("a folder that stays")).expect("there");
        let mut retention = from(&files, start).await;
        retention.look(at(minute, minute)).await;
        retention.look(at(week + 2 * minute, 2 * minute)).await;
        assert!(is_there().await, "the clock jumped by a week while the service ran");
        files.close().await;
        drop((retention, files));

        let now = at(2 * week, 3 * minute);
        let mut retention = from(&open(), now).await;
        retention.look(at(2 * week + minute, 4 * minute)).await;
        assert!(is_there().await, "it jumped while the service was stopped");
        retention.look(at(2 * week + week / 2, 4 * minute + week / 2)).await;
        assert!(!is_there().await, "half a week later it is old at last");
    }
}
