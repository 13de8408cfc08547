//! Whether what is stored stays stored: watches folder and store, and says when they fail and when they work again.
//!
//! Folder and store count their failures, and [`Storage::watch`] compares the counts. A part that failed is tried with a
//! write of its own until it works; meanwhile the service is not ready and no job is begun. Where there is only too
//! little room for more uploads the service is not ready, but jobs go on: they make room.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::files::{Files, blocking};
use super::health::{Health, Part};
use super::store::{JobStore, ListQuery, Queue, State};
use crate::error::Result;

/// Time between two looks.
const INTERVAL: Duration = Duration::from_millis(500);

/// Time after which the folder is tried although nothing failed.
const TRIED_ANYWAY: Duration = Duration::from_secs(10);

/// Jobs that are read from the store at once.
const PAGE: usize = 1000;

/// The state of folder and store.
#[derive(Debug)]
pub(super) struct Storage {
    files: Arc<Files>,
    store: Arc<dyn JobStore>,
    health: Arc<Health>,
    works: watch::Sender<bool>,
}

impl Storage {
    /// Folder and store, which just worked.
    pub fn new(files: Arc<Files>, store: Arc<dyn JobStore>, health: Arc<Health>) -> Self {
        Self { files, store, health, works: watch::Sender::new(true) }
    }

    /// Completes once folder and store take what is written.
    pub async fn works(&self) {
        let _ = self.works.subscribe().wait_for(|works| *works).await;
    }

    /// Looks after folder and store until `stop`.
    pub async fn watch(&self, stop: CancellationToken) {
        let mut seen = (0, 0);
        let mut tried = Instant::now();
        loop {
            tokio::select! {
                () = stop.cancelled() => return,
                () = tokio::time::sleep(INTERVAL) => {}
            }
            let failures = (self.files.failures(), self.store.statistics().failures);
            let works = *self.works.borrow();
            if failures != seen || !works || tried.elapsed() >= TRIED_ANYWAY {
                seen = failures;
                tried = Instant::now();
                self.look().await;
            } else {
                self.look_at_room().await;
            }
        }
    }

    /// Tries both.
    async fn look(&self) {
        self.give_back_room().await;
        let files = Arc::clone(&self.files);
        let folder = match blocking(move || files.probe()).await {
            Ok(tried) => tried,
            Err(error) => Err(error),
        };
        let store = self.store.probe().await;
        let works = folder.is_ok() && store.is_ok();
        self.say(Part::Store, store);
        match folder {
            Ok(()) => self.look_at_room().await,
            failed => self.say(Part::Disk, failed),
        }
        self.works.send_if_modified(|before| std::mem::replace(before, works) != works);
    }

    /// Gives back what jobs were promised that ended elsewhere than in the pipeline, as when they were reclaimed.
    async fn give_back_room(&self) {
        for job in self.files.promised_jobs() {
            match self.store.get(job).await {
                // one that is just being accepted is not there yet
                Ok(Some(found)) if found.state == State::Failed => self.files.give_back_of(job, found.attempt),
                Ok(Some(found)) if found.state.is_ended() => self.files.give_back(job),
                Ok(_) => {}
                Err(_) => return,
            }
        }
    }

    async fn look_at_room(&self) {
        let files = Arc::clone(&self.files);
        let _ = blocking(move || files.make_ballast()).await;
        if let Ok(bytes) = self.store.free_bytes().await {
            self.files.free_in_store(bytes);
        }
        self.say(Part::Disk, self.files.check_root().and_then(|()| self.files.check_room(0)));
    }

    fn say(&self, part: Part, tried: Result<()>) {
        match tried {
            Ok(()) => self.health.clear(part),
            Err(error) => self.health.fail(part, error.message),
        }
    }
}

/// Promises jobs that were accepted before the service was started room for their results again, oldest first. The
/// ballast is made after that, so that it takes none of their room.
pub(super) async fn promise_again(files: &Arc<Files>, store: &dyn Queue, most_faces: u64) -> Result<()> {
    let mut jobs = Vec::new();
    for state in [State::Running, State::Queued] {
        let mut query = ListQuery { state: Some(state), limit: PAGE, ..ListQuery::default() };
        loop {
            let page = store.list(&query).await?;
            jobs.extend(page.jobs);
            match page.next {
                Some(next) => query.cursor = Some(next),
                None => break,
            }
        }
    }
    jobs.sort_by_key(|job| job.created_at);
    files.promise_again(jobs.iter(), most_faces);
    let files = Arc::clone(files);
    blocking(move || files.make_ballast()).await
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::faults::Faults;
    use crate::service::files::DiskLimits;
    use crate::service::store::memory::MemoryStore;
    use crate::service::store::tests::{RULES, new_job};

    #[tokio::test]
    async fn the_ballast_takes_no_room_that_jobs_were_promised() {
        let folder = tempfile::tempdir().expect("a folder");
        let ballast = folder.path().join("ballast");
        let store = MemoryStore::new(RULES).expect("a store");
        for is_promised in [true, false] {
            let files = Files::open(Some(folder.path()), DiskLimits::default(), Faults::default());
            let files = Arc::new(files.expect("it opens"));
            let mut job = new_job();
            // a result larger than any disk
            job.spec.is_small = true;
            job.spec.bytes = 1 << 60;
            if is_promised {
                store.create(job.clone()).await.expect("created");
            }
            promise_again(&files, &store, u64::MAX).await.expect("promised");
            assert_eq!(ballast.exists(), !is_promised);
            for job in files.promised_jobs() {
                store.cancel(job).await.expect("cancelled");
            }
            files.close().await;
        }
    }
}
