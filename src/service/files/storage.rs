//! Watches the data folder and the store, and sets the health of both.
//!
//! Folder and store count their failures. After one, [`Storage::watch`] writes to the part that failed until it works;
//! meanwhile the service is not ready and no job begins. With too little room for uploads the service is not ready
//! either, but jobs continue, because they make room. While jobs cannot read or write their files, it is degraded.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use tesserae_mesh::error::Result;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::files::Files;
use crate::ops::blocking;
use crate::ops::health::{Health, Part};
use crate::store::{SMALL_BLOBS, Store};

pub(crate) struct Storage {
    files: Arc<Files>,
    store: Arc<Store>,
    health: Arc<Health>,
    works: watch::Sender<bool>,
}

impl Storage {
    pub fn new(files: Arc<Files>, store: Arc<Store>, health: Arc<Health>) -> Self {
        Self { files, store, health, works: watch::Sender::new(true) }
    }

    /// Completes once folder and store take what is written.
    pub async fn works(&self) {
        let _ = self.works.subscribe().wait_for(|works| *works).await;
    }

    pub async fn watch(self: Arc<Self>, stop: CancellationToken) {
        let mut seen = (0, 0);
        let mut tried = Instant::now();
        while stop.run_until_cancelled(tokio::time::sleep(Duration::from_millis(500))).await.is_some() {
            let failures = (self.files.failures.load(Ordering::Relaxed), self.store.statistics().failures);
            // tried now and then although nothing failed
            if failures != seen || !*self.works.borrow() || tried.elapsed() >= Duration::from_secs(10) {
                (seen, tried) = (failures, Instant::now());
                self.look().await;
            } else {
                self.look_at_room().await;
            }
        }
    }

    async fn look(&self) {
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

    pub async fn look_at_room(&self) {
        self.files.make_ballast().await;
        if let Ok(bytes) = self.store.free_bytes().await
            && self.files.is_short_of(bytes)
        {
            // a failure is counted by the store
            let _ = self.store.give_back().await;
        }
        self.say(Part::Disk, self.files.check_root().and_then(|()| self.files.check_room(SMALL_BLOBS, 0)));
    }

    fn say(&self, part: Part, tried: Result<()>) {
        match (tried, self.files.stuck.load(Ordering::Relaxed)) {
            (Err(error), _) => self.health.fail(part, error.message),
            (Ok(()), 1..) if part == Part::Disk => {
                self.health.degrade(part, "there are jobs that cannot read or write files of theirs; the log says why");
            }
            (Ok(()), _) => self.health.clear(part),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::faults::Faults;
    use crate::ops::health::why_not_ready;
    use crate::store::tests::{RULES, new_job};

    #[tokio::test]
    async fn a_full_disk_gets_room_back_from_the_store() {
        let folder = tempfile::tempdir().expect("a folder");
        // never any room: whatever the store keeps free is needed
        let total = rustix::fs::statvfs(folder.path()).map(|found| found.f_blocks * found.f_frsize).expect("known");
        let files = Files::open(Some(folder.path()), None, total - 1, Faults::default()).expect("it opens");
        let (files, health) = (Arc::new(files), Arc::<Health>::default());
        let path = files.database();
        let store = Arc::new(Store::open(&path, false, RULES, Faults::default()).await.expect("a store"));
        let storage = Storage::new(files, Arc::clone(&store), Arc::clone(&health));
        let mut job = new_job();
        job.spec.buffers = vec!["x".repeat(10 << 20)];
        store.create(job.clone()).await.expect("created");
        store.cancel(job.id).await.expect("cancelled");
        store.delete(job.id).await.expect("deleted");
        for _ in 0..20 {
            storage.look_at_room().await;
        }
        assert!(path.metadata().expect("there").len() < 1 << 20);
        assert!(why_not_ready(&health.conditions()).is_some(), "no small job is taken");
        store.close().await;
    }
}
