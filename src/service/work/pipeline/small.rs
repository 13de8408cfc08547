//! Small meshes: one thread works on each, several meshes at a time.
//!
//! Threads that share a small mesh lose more time on synchronisation than they gain: 5,000 faces take one thread about
//! as long as two (measured), so two at a time are done twice as fast. Their pools have one thread each; parallel code
//! runs sequentially there. `Device::another` says whether a device takes several meshes at a time.

use std::sync::Arc;
use std::thread::available_parallelism;

use rayon::ThreadPool;
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::sync::{Mutex, oneshot};

use super::bounds::{caught, pool};

/// Faces of the largest small mesh.
pub(super) const SMALL_FACES: usize = 8192;

/// Bytes of the largest files that are taken for a small mesh before its faces are known.
pub(super) const SMALL_BYTES: u64 = 1 << 20;

/// Pools of threads that work on a mesh each.
#[derive(Debug)]
pub(crate) struct SmallMeshes {
    /// Those without work.
    idle: Mutex<UnboundedReceiver<Arc<ThreadPool>>>,
    back: UnboundedSender<Arc<ThreadPool>>,
}

/// A pool, taken until this is dropped or what it runs has ended.
#[derive(Debug)]
pub(crate) struct Thread {
    pool: Arc<ThreadPool>,
    back: UnboundedSender<Arc<ThreadPool>>,
}

impl SmallMeshes {
    /// As many threads as there are processors, but two at least, so that no mesh waits for the reading of another.
    pub fn start() -> Result<Self> {
        Self::pools(available_parallelism().map_or(2, |count| count.get().max(2)), 1, "small")
    }

    /// As many threads as there are processors for one mesh at a time: a short one, beside a long one that the device
    /// is at. The system shares the processors between both: a short mesh takes at most about twice its own time, and a
    /// long one is held up by no more than that.
    pub fn beside() -> Result<Self> {
        Self::pools(1, 0, "beside")
    }

    fn pools(count: usize, threads: usize, name: &'static str) -> Result<Self> {
        let (back, idle) = unbounded_channel();
        for index in 0..count {
            let _ = back.send(Arc::new(pool(threads, move |thread| format!("{name}-{index}-{thread}"))?));
        }
        Ok(Self { idle: Mutex::new(idle), back })
    }

    pub async fn thread(&self) -> Result<Thread> {
        let pool = self.idle.lock().await.recv().await.ok_or_else(gone)?;
        Ok(Thread { pool, back: self.back.clone() })
    }
}

impl Thread {
    /// Runs `work`. A panic becomes an error. Goes on when the future is dropped.
    pub async fn run<T: Send + 'static>(self, work: impl FnOnce() -> Result<T> + Send + 'static) -> Result<T> {
        let (reply, outcome) = oneshot::channel();
        let pool = Arc::clone(&self.pool);
        pool.spawn(move || {
            let outcome = caught(work);
            drop(self);
            // the receiver may be gone
            let _ = reply.send(outcome);
        });
        outcome.await.map_err(|_| gone())?
    }
}

fn gone() -> Error {
    Error::new(Kind::Internal, "the threads for small meshes are gone")
}

impl Drop for Thread {
    fn drop(&mut self) {
        let _ = self.back.send(Arc::clone(&self.pool));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn meshes_run_at_once_on_a_thread_each_and_a_panic_leaves_them_to_others() {
        let small = SmallMeshes::start().expect("threads");
        let count = small.idle.lock().await.len();
        let together = Arc::new(std::sync::Barrier::new(count));
        for _ in 0..3 {
            let all = (0..count).map(async |_| {
                let together = Arc::clone(&together);
                let work = move || {
                    assert_eq!(rayon::current_num_threads(), 1);
                    together.wait();
                    Ok(std::thread::current().id())
                };
                small.thread().await?.run(work).await
            });
            let mut threads = futures_util::future::try_join_all(all).await.expect("run");
            threads.sort_by_key(|id| format!("{id:?}"));
            threads.dedup();
            assert_eq!(threads.len(), count);
            for _ in 0..count {
                let thread = small.thread().await.expect("a thread");
                let failed = thread.run(|| -> Result<()> { panic!("on purpose") }).await.expect_err("a panic");
                assert_eq!(failed.kind, Kind::Internal);
            }
        }
        assert_eq!(small.idle.lock().await.len(), count);
    }
}
