//! Watches the data folder and the store, and sets the health of both.
//!
//! Folder and store count their failures, and [`Storage::watch`] reads the counts. It then writes to the part that
//! failed until that works; meanwhile the service is not ready and no job begins. With too little room for uploads the
//! service is not ready either, but jobs continue, because they make room.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::{Mutex, watch};
use tokio_util::sync::CancellationToken;
use tracing::Instrument as _;

use super::blocking::blocking;
use super::files::Files;
use super::health::{Health, Part};
use super::store::{Job, ListQuery, Retried, State, Store};
use crate::error::{Error, Kind, Result};
use crate::mesh::Limits;

/// Time between two looks at the counts.
const INTERVAL: Duration = Duration::from_millis(500);

/// Time after which the folder is tried although nothing failed.
const TRIED_ANYWAY: Duration = Duration::from_secs(10);

/// Jobs that are read from the store at once.
const PAGE: usize = 1000;

/// The state of folder and store.
#[derive(Debug)]
pub(super) struct Storage {
    files: Arc<Files>,
    store: Arc<Store>,
    health: Arc<Health>,
    works: watch::Sender<bool>,
    /// Held while a job is made to wait again.
    retrying: Mutex<()>,
}

impl Storage {
    /// Folder and store, which just worked.
    pub fn new(files: Arc<Files>, store: Arc<Store>, health: Arc<Health>) -> Self {
        Self { files, store, health, works: watch::Sender::new(true), retrying: Mutex::default() }
    }

    /// Completes once folder and store take what is written.
    pub async fn works(&self) {
        let _ = self.works.subscribe().wait_for(|works| *works).await;
    }

    /// Promises a failed job room and makes it wait again, on a task of its own: when its caller goes, as the handler
    /// does whose client hangs up, the retry is completed and its promise kept or given back.
    pub async fn retry(self: &Arc<Self>, job: Job, limits: Limits) -> Result<Retried> {
        let this = Arc::clone(self);
        let retried = tokio::spawn(async move { this.retry_in_turn(&job, &limits).await }.in_current_span()).await;
        retried.map_err(|error| Error::new(Kind::Internal, format_args!("the job was not run again: {error}")))?
    }

    /// A job that stays failed keeps no promise: two requests for one job share its promise, so they come one after the
    /// other.
    async fn retry_in_turn(&self, job: &Job, limits: &Limits) -> Result<Retried> {
        let _turn = self.retrying.lock().await;
        self.files.promise_retry(job, limits).await?;
        let retried = self.store.retry(job.id).await;
        if !matches!(retried, Ok(Retried::Queued(_) | Retried::NotFailed(_))) {
            self.files.give_back(job.id);
        }
        retried
    }

    /// Watches folder and store until `stop`.
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
            Ok(Ok(())) => self.files.probe_elsewhere().await,
            Ok(Err(error)) | Err(error) => Err(error),
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

    /// Gives back the promises of jobs that ended outside of the pipeline, as reclaimed jobs do.
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
            if self.files.is_short_of(bytes) {
                // a failure is counted by the store
                let _ = self.store.give_back().await;
            }
        }
        self.say(Part::Disk, self.files.check_root().and_then(|()| self.files.check_small_job()));
    }

    fn say(&self, part: Part, tried: Result<()>) {
        match tried {
            Ok(()) => self.health.clear(part),
            Err(error) => self.health.fail(part, error.message),
        }
    }
}

/// Renews the promises of jobs that were accepted before the service was started, oldest first. The ballast is made
/// after that, so that it takes none of their room.
pub(super) async fn promise_again(files: &Arc<Files>, store: &Store, limits: &Limits) -> Result<()> {
    let mut jobs = Vec::new();
    // jobs of a shared store run anywhere
    let states: &[State] = if store.is_shared() { &[] } else { &[State::Running, State::Queued] };
    for &state in states {
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
    files.promise_again(&jobs, limits).await?;
    let files = Arc::clone(files);
    blocking(move || files.make_ballast()).await
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;
    use crate::service::faults::{FaultPoint, Faults};
    use crate::service::files::DiskLimits;
    use crate::service::store::tests::{RULES, new_job, store_in};
    use crate::service::store::{Release, Rules, Store};

    /// Two retries of a job, of which the first fails: the queue is full until the second one begins.
    async fn two_retries(is_second_awaited: bool) {
        let folder = tempfile::tempdir().expect("a folder");
        let faults = Faults::default();
        let files = Files::open(Some(folder.path()), None, DiskLimits::default(), faults.clone()).expect("it opens");
        let (files, rules) = (Arc::new(files), Rules { max_queued: 1, max_attempts: 1, ..RULES });
        let path = files.database();
        let store: Arc<Store> = Arc::new(Store::open(&path, rules, faults.clone()).await.expect("a store"));
        let storage = Arc::new(Storage::new(Arc::clone(&files), Arc::clone(&store), Arc::default()));
        let given_up = new_job().id;
        let mut job = new_job();
        job.id = given_up;
        store.create(job).await.expect("created");
        let ticket = store.claim(1, Duration::from_secs(60)).await.expect("claimable")[0].0;
        store.begin(ticket).await.expect("it counts");
        let failure = Release::Failed(Error::new(Kind::DeviceLost, "lost"));
        assert_eq!(store.release(ticket, failure).await, Ok(State::Failed));
        let job = store.get(given_up).await.expect("readable").expect("there");
        let other = new_job();
        store.create(other.clone()).await.expect("the queue is full now");

        let retry = || {
            let (storage, job) = (Arc::clone(&storage), job.clone());
            async move { storage.retry(job, Limits::default()).await }
        };
        faults.hold(FaultPoint::Commit);
        let first = tokio::spawn(retry());
        while faults.waiting(FaultPoint::Commit) == 0 {
            tokio::task::yield_now().await;
        }
        let cancelled = tokio::spawn({
            let store = Arc::clone(&store);
            async move { store.cancel(other.id).await }
        });
        let second = is_second_awaited.then(|| tokio::spawn(retry()));
        if !is_second_awaited {
            assert!(retry().now_or_never().is_none(), "it waits for the first");
        }
        // on this one thread each has come as far as it can
        for _ in 0..10 {
            tokio::task::yield_now().await;
        }
        faults.disarm();
        assert_eq!(first.await.expect("no panic").expect_err("the queue is full").kind, Kind::QueueFull);
        cancelled.await.expect("no panic").expect("cancelled");
        if let Some(second) = second {
            assert!(matches!(second.await.expect("no panic"), Ok(Retried::Queued(_))));
        }
        while store.get(given_up).await.expect("readable").expect("there").state != State::Queued {
            tokio::task::yield_now().await;
        }
        assert_eq!(files.promised_jobs(), [given_up]);
    }

    #[tokio::test]
    async fn a_retry_that_fails_leaves_the_promise_of_another_retry_of_its_job() {
        two_retries(true).await;
    }

    #[tokio::test]
    async fn a_retry_happens_although_its_caller_is_gone() {
        two_retries(false).await;
    }

    #[tokio::test]
    async fn a_service_is_ready_when_it_takes_a_small_job() {
        for limit in [700 << 10, 50 << 10] {
            let folder = tempfile::tempdir().expect("a folder");
            let limits = DiskLimits { max_bytes: Some(limit), min_free_bytes: 0 };
            let files = Files::open(Some(folder.path()), None, limits, Faults::default()).expect("it opens");
            let (files, health) = (Arc::new(files), Arc::<Health>::default());
            let elsewhere = tempfile::tempdir().expect("a folder");
            let store = Arc::new(store_in(elsewhere.path()).await);
            let storage = Storage::new(Arc::clone(&files), store, Arc::clone(&health));
            storage.look_at_room().await;
            let is_taken = files.promise(new_job().id, 0, 100 << 10).is_ok();
            assert_eq!(health.why_not_ready().is_none(), is_taken, "{limit}");
        }
    }

    #[tokio::test]
    async fn a_full_disk_gets_room_back_from_the_store() {
        let folder = tempfile::tempdir().expect("a folder");
        // never any room: whatever the store keeps free is needed
        let total = rustix::fs::statvfs(folder.path()).map(|found| found.f_blocks * found.f_frsize).expect("known");
        let limits = DiskLimits { min_free_bytes: total - 1, ..DiskLimits::default() };
        let files = Arc::new(Files::open(Some(folder.path()), None, limits, Faults::default()).expect("it opens"));
        let path = files.database();
        let store = Arc::new(Store::open(&path, RULES, Faults::default()).await.expect("a store"));
        let storage = Storage::new(Arc::clone(&files), Arc::clone(&store), Arc::default());
        let mut job = new_job();
        job.spec.buffers = vec!["x".repeat(10 << 20)];
        store.create(job.clone()).await.expect("created");
        store.cancel(job.id).await.expect("cancelled");
        store.delete(job.id).await.expect("deleted");
        for _ in 0..20 {
            storage.look_at_room().await;
        }
        assert!(path.metadata().expect("there").len() < 1 << 20);
        store.close().await;
    }

    const EVERYTHING: Limits = Limits { max_bytes: u64::MAX, max_faces: u64::MAX, max_faces_per_byte: None };

    #[tokio::test]
    async fn the_ballast_takes_no_room_that_jobs_were_promised() {
        let folder = tempfile::tempdir().expect("a folder");
        let ballast = folder.path().join("ballast");
        let store = store_in(folder.path()).await;
        for is_promised in [true, false] {
            let files = Files::open(Some(folder.path()), None, DiskLimits::default(), Faults::default());
            let files = Arc::new(files.expect("it opens"));
            let mut job = new_job();
            // a result larger than any disk
            job.spec.is_small = true;
            job.spec.bytes = 1 << 60;
            if is_promised {
                store.create(job.clone()).await.expect("created");
            }
            promise_again(&files, &store, &EVERYTHING).await.expect("promised");
            assert_eq!(ballast.exists(), !is_promised);
            for job in files.promised_jobs() {
                store.cancel(job).await.expect("cancelled");
            }
            files.close().await;
        }
    }
}
