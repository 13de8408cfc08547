//! Retention: deletes jobs some time after their end, with their results, and sweeps files that belong to no job, as
//! after a crash.
//!
//! No job expires at once because the system's clock jumped forward: while the operator sets it right, nothing is
//! deleted. A jump cannot be distinguished from a time in which the service was stopped.
//!
//! Files of a job that the store does not know stay for a while, since a store that was restored from an older copy
//! knows fewer jobs, and removing their files would make the loss final. An upload that is not whole goes at once.
//!
//! A place that is shared holds uploads that come in at another process, which look like those that a killed process
//! left: there, they count as unknown from a [`DAY`] on. Ages are by the clock of the place.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use futures_util::future::join_all;
use object_store::path::Path as BlobPath;
use tesserae_mesh::error::Result;
use tokio_util::sync::CancellationToken;

use super::folder::Files;
use super::root::{Folder, MESH, RESULTS, UPLOADS};
use crate::files::job_blobs;
use crate::store::{Deletion, JobId, State, Store};

const AT_ONCE: usize = 100;
const INTERVAL: Duration = Duration::from_secs(30);

/// Least time for which files stay of jobs that the store does not know.
const UNKNOWN: Duration = Duration::from_secs(7 * 86_400);

/// Age from which on files at a shared place come in nowhere any more.
const DAY: Duration = Duration::from_secs(86_400);

/// The clock jumped when it is ahead of the time that passed by more than this.
const JUMP: Duration = Duration::from_secs(3600);
/// Time after a jump in which nothing is deleted.
const PAUSE: Duration = Duration::from_secs(600);

/// The system's clock, which people and other computers set, and the steady one, read at once.
pub(crate) type Clocks = (SystemTime, Instant);

pub(crate) struct Retention {
    files: Arc<Files>,
    store: Arc<Store>,
    /// Time for which an ended job is kept; for ever when none.
    kept: Option<Duration>,
    last: Clocks,
    pause: Option<Instant>,
}

impl Retention {
    /// For the jobs of a store. The clock was right when the newest job was created.
    pub async fn new(files: &Arc<Files>, store: &Arc<Store>, kept: Option<Duration>, now: Clocks) -> Result<Self> {
        // a stop and a jump of the clock look alike
        let last = (store.newest().await?.unwrap_or(now.0), now.1);
        Ok(Self { files: Arc::clone(files), store: Arc::clone(store), kept, last, pause: None })
    }

    pub async fn run(mut self, stop: CancellationToken) {
        let kept = self.kept;
        let interval = kept.map_or(INTERVAL, |kept| (kept / 10).clamp(Duration::from_millis(100), INTERVAL));
        // the first sweep is early: a service that is started again every hour would never sweep otherwise
        let (mut swept, mut pause) = (Instant::now(), Duration::from_secs(5));
        while stop.run_until_cancelled(tokio::time::sleep(interval)).await.is_some() {
            // one service does it for all that share the store
            if !self.store.may_clean_up().await.unwrap_or(false) {
                continue;
            }
            if self.look((SystemTime::now(), Instant::now())).await && swept.elapsed() >= pause {
                (swept, pause) = (Instant::now(), Duration::from_secs(3600));
                let old = kept.and_then(|kept| SystemTime::now().checked_sub(kept.max(UNKNOWN)));
                match self.files.sweep(self.store.as_ref(), old).await {
                    Ok(removed) => tracing::debug!(removed, "swept"),
                    Err(error) => tracing::warn!(%error, "the data folder cannot be swept now"),
                }
            }
        }
    }

    /// Deletes the jobs that have expired; false if the clock jumped since the last look, or a while ago, instead.
    async fn look(&mut self, now: Clocks) -> bool {
        let (wall, steady) = now;
        let (last_wall, last_steady) = std::mem::replace(&mut self.last, now);
        let expected = last_wall + steady.saturating_duration_since(last_steady);
        let ahead = wall.duration_since(expected).unwrap_or_default();
        if ahead > JUMP {
            self.pause = Some(steady + PAUSE);
            let why = "the clock jumped forward, or the service was stopped: no job expires for ten minutes";
            tracing::warn!(seconds = ahead.as_secs(), "{why}");
        }
        if self.pause.is_some_and(|end| steady < end) {
            return false;
        }
        if let Some(before) = self.kept.and_then(|kept| wall.checked_sub(kept))
            && let Err(error) = self.expire(before).await
        {
            tracing::warn!(%error, "expired jobs cannot be deleted now");
        }
        true
    }

    async fn expire(&self, before: SystemTime) -> Result<()> {
        loop {
            let old = self.store.ended_before(before, AT_ONCE).await?;
            // at once: they share a transaction, as many jobs may end as begin
            let outcomes = join_all(old.iter().map(async |id| {
                if job_blobs::delete(&self.files, self.store.as_ref(), *id).await? == Deletion::Deleted {
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

impl Files {
    /// Removes uploads of jobs that were never accepted, or have ended and are not kept for a retry, and results of
    /// attempts that neither run nor succeeded. Uploads that are coming in stay, and so do files of unknown jobs that
    /// were stored after `old`, all of them when none. Returns how many folders went.
    pub async fn sweep(&self, store: &Store, mut old: Option<SystemTime>) -> Result<usize> {
        let (mut removed, mut unknown, mut counted) = (0, 0, None);
        if self.is_shared() {
            let now = self.blobs.probe().await?;
            // killed services leave uploads: they go even where jobs are kept for ever
            old = now.checked_sub(UNKNOWN).map(|known| old.map_or(known, |old| old.min(known)));
            counted = now.checked_sub(DAY);
            if let Some(old) = counted
                && let Err(error) = self.blobs.sweep_probes(old).await
            {
                tracing::warn!("{error}");
            }
        }
        for id in self.jobs_in(UPLOADS).await? {
            // looked at before the store, which knows an accepted one before it stops coming in
            let is_coming_in = self.incoming.lock().contains(&id);
            match store.get(id).await? {
                _ if is_coming_in => {}
                Some(job) if !job.state.is_ended() || job.keeps_upload() => {}
                None if self.stays(Folder::Upload(id), [old, counted], &mut unknown).await? => {}
                _ => {
                    self.remove_upload(id).await;
                    removed += 1;
                }
            }
        }
        for id in self.jobs_in(RESULTS).await? {
            // listed before the store is read, which knows an attempt before it has files
            let attempts = self.blobs.names(&Folder::Results(id).path()).await?;
            match store.get(id).await? {
                Some(job) => {
                    let keeps_last = matches!(job.state, State::Running | State::Succeeded);
                    for attempt in attempts.iter().filter_map(|name| name.parse().ok()) {
                        if !(keeps_last && attempt == job.attempt) {
                            self.remove_result(id, attempt).await;
                            removed += 1;
                        }
                    }
                }
                None if self.stays(Folder::Results(id), [old, counted], &mut unknown).await? => {}
                None => {
                    self.remove(id).await;
                    removed += 1;
                }
            }
        }
        self.unknown.store(unknown, Ordering::Relaxed);
        Ok(removed)
    }

    /// Whether a folder of a job that the store does not know stays: it has a file that is newer than `old`. Adds it to
    /// `unknown` if none is newer than `counted`.
    async fn stays(&self, folder: Folder, [old, counted]: [Option<SystemTime>; 2], unknown: &mut u64) -> Result<bool> {
        let is_upload_of_one = matches!(folder, Folder::Upload(_)) && !self.is_shared();
        if is_upload_of_one && !self.blobs.names(&folder.path()).await?.iter().any(|name| name == MESH) {
            return Ok(false);
        }
        let newest = self.blobs.newest(&folder.path()).await?;
        let Some(newest) = newest.filter(|&newest| old.is_none_or(|old| newest > old)) else { return Ok(false) };
        *unknown += u64::from(counted.is_none_or(|counted| newest <= counted));
        Ok(true)
    }

    /// The jobs that have a folder. What has another name is not the service's.
    pub(super) async fn jobs_in(&self, folder: &str) -> Result<Vec<JobId>> {
        let names = self.blobs.names(&BlobPath::from(folder)).await?;
        Ok(names.iter().filter_map(|name| name.parse().ok()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::faults::Faults;
    use crate::store::End;
    use crate::store::tests::{new_job, store_in};

    #[tokio::test]
    async fn a_clock_that_jumps_forward_makes_no_job_expire_at_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let opened = Files::open(Some(folder.path()), None, 0, Faults::default());
        let (files, store) = (Arc::new(opened.expect("it opens")), Arc::new(store_in(folder.path()).await));
        let (minute, week) = (Duration::from_secs(60), Duration::from_secs(7 * 86_400));
        let ended = async || {
            store.create(new_job()).await.expect("created");
            let claimed = store.claim(1, week).await.expect("claimable");
            store.end(claimed[0].0, End::Cancelled).await.expect("ended");
            claimed[0].0.job
        };
        let is_there = async |job| store.get(job).await.expect("readable").is_some();
        let job = ended().await;

        let start = (SystemTime::now(), Instant::now());
        let at = |wall: Duration, steady: Duration| (start.0 + wall, start.1 + steady);
        let from = async |now| Retention::new(&files, &store, Some(week), now).await.expect("readable");
        let mut retention = from(start).await;
        assert!(retention.look(at(minute, minute)).await);
        assert!(!retention.look(at(week + 2 * minute, 2 * minute)).await, "while the service runs");
        assert!(!retention.look(at(week + PAUSE, PAUSE)).await && is_there(job).await);
        let later = 2 * PAUSE;
        assert!(retention.look(at(later, later)).await && is_there(job).await, "it was set right");
        assert!(!retention.look(at(2 * week, later + minute)).await && is_there(job).await);
        assert!(retention.look(at(2 * week + PAUSE, later + minute + PAUSE)).await);
        assert!(!is_there(job).await, "it was not");

        let job = ended().await;
        let mut retention = from(at(2 * week, minute)).await;
        assert!(!retention.look(at(2 * week + minute, 2 * minute)).await && is_there(job).await, "it was stopped");
        assert!(retention.look(at(2 * week + PAUSE, 2 * minute + PAUSE)).await && !is_there(job).await);
        let mut retention = from(start).await;
        assert!(retention.look(at(week, week)).await, "time passes as the clock says");
    }
}
