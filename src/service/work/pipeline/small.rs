//! Small meshes: one thread works on each, several meshes at a time.
//!
//! Threads that share a small mesh lose more time on synchronisation than they gain: 5,000 faces take one thread about
//! as long as two (measured), so two at a time are done twice as fast. Their pools have one thread each; parallel code
//! runs sequentially there. `Device::another` says whether a device takes several meshes at a time.

use std::sync::Arc;
use std::thread::available_parallelism;
use std::time::Duration;

use parking_lot::Mutex;
use rayon::ThreadPool;
use tesserae_mesh::error::{Error, Result};
use tokio::sync::{Semaphore, oneshot};

use super::bounds::{caught, pool, within};

/// Faces of the largest small mesh.
pub(super) const SMALL_FACES: usize = 8192;

/// Bytes of the largest files that are taken for a small mesh before its faces are known.
pub(super) const SMALL_BYTES: u64 = 1 << 20;

/// Pools of threads that work on a mesh each. A pool starts when no other is idle.
#[derive(Debug)]
pub(crate) struct SmallMeshes {
    name: &'static str,
    /// Threads of a pool; 0 for as many as there are processors.
    threads: usize,
    /// One for each pool that may work.
    places: Arc<Semaphore>,
    idle: Arc<Mutex<Vec<Arc<ThreadPool>>>>,
}

impl SmallMeshes {
    /// As many threads as there are processors, but two at least, so that no mesh waits for the reading of another.
    pub fn new() -> Self {
        Self::pools(available_parallelism().map_or(2, |count| count.get().max(2)), 1, "small")
    }

    /// As many threads as there are processors for one short mesh at a time, beside a long one that the device is at.
    /// Both share the processors: the short one takes at most about twice its time, and delays the other by that.
    pub fn beside() -> Self {
        Self::pools(1, 0, "beside")
    }

    fn pools(count: usize, threads: usize, name: &'static str) -> Self {
        Self { name, threads, places: Arc::new(Semaphore::new(count)), idle: Arc::default() }
    }

    /// Runs `work` once a thread is free, for `limit` at the most; `work` goes on after that. A panic becomes an error.
    pub async fn run<T: Send + 'static>(
        &self,
        limit: Option<Duration>,
        work: impl FnOnce() -> Result<T> + Send + 'static,
    ) -> Result<T> {
        let gone = || Error::internal("the threads for small meshes are gone");
        let place = Arc::clone(&self.places).acquire_owned().await.map_err(|_| gone())?;
        let idle = Arc::clone(&self.idle);
        let last = idle.lock().pop();
        let pool = last.or_else(|| pool(self.threads, self.name));
        let (reply, outcome) = oneshot::channel();
        let of_work = pool.clone();
        let work = move || {
            let outcome = caught(work);
            idle.lock().extend(of_work);
            drop(place);
            // the receiver may be gone
            let _ = reply.send(outcome);
        };
        match pool {
            Some(pool) => pool.spawn(work),
            None => rayon::spawn(work),
        }
        within(limit, async { outcome.await.map_err(|_| gone())? }).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn meshes_run_at_once_on_a_thread_each_and_a_panic_leaves_them_to_others() {
        let small = SmallMeshes::new();
        let count = small.places.available_permits();
        let together = Arc::new(std::sync::Barrier::new(count));
        for _ in 0..3 {
            let all = (0..count).map(async |_| {
                let together = Arc::clone(&together);
                let work = move || {
                    assert_eq!(rayon::current_num_threads(), 1);
                    together.wait();
                    Ok(std::thread::current().id())
                };
                small.run(None, work).await
            });
            let mut threads = futures_util::future::try_join_all(all).await.expect("run");
            threads.sort_by_key(|id| format!("{id:?}"));
            threads.dedup();
            assert_eq!(threads.len(), count);
            for _ in 0..count {
                let failed = small.run(None, || -> Result<()> { panic!("on purpose") }).await.expect_err("a panic");
                assert_eq!(failed.kind, tesserae_mesh::Kind::Internal);
            }
        }
        assert_eq!((small.places.available_permits(), small.idle.lock().len()), (count, count));
    }
}
