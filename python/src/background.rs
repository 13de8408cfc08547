//! Work on threads of the library, while Python runs.
//!
//! The calling thread releases the interpreter's lock and waits; between waits it calls functions of Python with what
//! the work reports, and looks for signals. A signal, or an exception of such a function, cancels the work. Work looks
//! at its flag in every iteration, but not while it reads a mesh or builds the surface. So the caller waits for
//! [`GRACE`] and then leaves the work to end by itself: work owns everything that it uses.
//!
//! # Processes that fork
//!
//! Threads do not survive a fork, and a pool without its threads waits for ever. So all work runs on a pool of this
//! module, not on rayon's global one, and each process makes its own: a pool belongs to the process with its number.
//! The pool of the parent is leaked in the child, where dropping it would wait for threads that are not there.
//!
//! # Many callers
//!
//! A thread of the pool that waits for a part of its work takes up other work, whole jobs too, on the same stack. So
//! no more than [`MOST_AT_ONCE`] jobs are in the pool; others wait for one of them to end.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::report::Row;
use tesserae_mesh::{Error, Result};

use crate::error::{exception, of_panic, raised};

/// Time between two looks for signals.
const PATIENCE: Duration = Duration::from_millis(20);

/// Time that cancelled work has to end before the caller goes on without it.
const GRACE: Duration = Duration::from_millis(50);

/// Jobs in the pool at most. Of 160 jobs that were begun at once, stacks of 2 MiB overflowed.
const MOST_AT_ONCE: usize = 32;

/// What work says.
enum Said<T> {
    Row(Row),
    Done(Result<T>),
}

/// Reports rows of running work; rows are lost where nothing listens.
pub struct Reporter {
    send: Option<Box<dyn Fn(Row) + Send + Sync>>,
    kept: Mutex<Option<Box<dyn Send>>>,
}

impl Reporter {
    /// Reports a row.
    pub fn row(&self, row: Row) {
        if let Some(send) = &self.send {
            send(row);
        }
    }

    /// Keeps one value, which is dropped after the result was sent: the caller does not wait for its memory to be
    /// freed.
    pub fn keep(&self, value: impl Send + 'static) {
        *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(value));
    }
}

/// Runs work on the pool and waits for it; calls `on_row` in this thread with its rows.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&Cancel, &Reporter) -> Result<T> + Send + 'static,
    on_row: Option<&Bound<'_, PyAny>>,
) -> PyResult<T> {
    let (sender, mut receiver) = channel();
    let cancel = Cancel::default();
    let reporter = Reporter { send: on_row.map(|_| reporting(sender.clone())), kept: Mutex::default() };
    let flag = cancel.clone();
    raised(py, workers())?.begin(Box::new(move || {
        let done = catch_unwind(AssertUnwindSafe(|| flag.check().and_then(|()| work(&flag, &reporter))));
        // what listens may have given up
        let _ = sender.send(Said::Done(done.unwrap_or_else(|payload| Err(of_panic(&*payload)))));
        // the caller goes on first, maybe on this processor
        std::thread::yield_now();
        drop(reporter);
    }));
    loop {
        let ours = &mut receiver; // a receiver may be moved to another thread, but not shared with one
        let said = py.detach(move || ours.recv_timeout(PATIENCE));
        let heard = match said {
            Ok(Said::Done(done)) => return raised(py, done),
            Ok(Said::Row(row)) => on_row.map_or(Ok(()), |on_row| call(on_row, row)),
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => {
                Err(exception(py, &Error::internal("a thread ended without a result")))
            }
        };
        if let Err(interruption) = heard.and_then(|()| py.check_signals()) {
            cancel.cancel();
            py.detach(|| wait_for_end(&mut receiver));
            return Err(interruption);
        }
    }
}

/// Runs work that reports nothing.
pub fn run_quietly<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send + 'static,
) -> PyResult<T> {
    run(py, |_, _| work(), None)
}

fn reporting<T: Send + 'static>(sender: Sender<Said<T>>) -> Box<dyn Fn(Row) + Send + Sync> {
    Box::new(move |row| {
        let _ = sender.send(Said::Row(row));
    })
}

/// Calls a function of Python with a row: whether it is one of a hierarchy's levels, and its numbers.
fn call(on_row: &Bound<'_, PyAny>, row: Row) -> PyResult<()> {
    match row {
        Row::Iteration(row) => {
            let phase = serde_json::to_value(row.phase).unwrap_or_default();
            let phase = phase.as_str().unwrap_or_default();
            on_row.call1((false, (row.iteration, phase, row.round, row.energy, row.moves, row.elapsed_us)))?;
        }
        Row::Round(row) => {
            on_row.call1((true, (row.round, row.clusters, row.energy, row.merges, row.moves)))?;
        }
    }
    Ok(())
}

/// Waits until the work ended, or [`GRACE`] is over.
fn wait_for_end<T>(receiver: &mut Receiver<Said<T>>) {
    let end = Instant::now() + GRACE;
    while let Ok(Said::Row(_)) = receiver.recv_timeout(end.saturating_duration_since(Instant::now())) {}
}

type Job = Box<dyn FnOnce() + Send>;

/// A pool, and the jobs in it and before it.
struct Workers {
    pool: ThreadPool,
    jobs: Mutex<Jobs>,
}

#[derive(Default)]
struct Jobs {
    begun: usize,
    waiting: VecDeque<Job>,
}

impl Workers {
    /// Begins a job, or lets it wait for its turn. A job does not panic.
    fn begin(self: &Arc<Self>, job: Job) {
        let mut jobs = self.jobs();
        if jobs.begun == MOST_AT_ONCE {
            jobs.waiting.push_back(job);
        } else {
            jobs.begun += 1;
            self.spawn(job);
        }
    }

    fn spawn(self: &Arc<Self>, job: Job) {
        let workers = Arc::clone(self);
        self.pool.spawn(move || {
            job();
            let mut jobs = workers.jobs();
            match jobs.waiting.pop_front() {
                Some(next) => workers.spawn(next),
                None => jobs.begun -= 1,
            }
        });
    }

    fn jobs(&self) -> MutexGuard<'_, Jobs> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The pool of this process, with a thread for each processor or as many as `RAYON_NUM_THREADS` says.
fn workers() -> Result<Arc<Workers>> {
    static WORKERS: Mutex<Option<(u32, Arc<Workers>)>> = Mutex::new(None);
    let process = std::process::id();
    let mut workers = WORKERS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, workers)) = workers.as_ref().filter(|(of, _)| *of == process) {
        return Ok(Arc::clone(workers));
    }
    let pool = ThreadPoolBuilder::new().thread_name(|number| format!("tesserae-{number}")).build();
    let pool = pool.map_err(|error| Error::unavailable(format_args!("cannot start threads: {error}")))?;
    let made = Arc::new(Workers { pool, jobs: Mutex::default() });
    if let Some(of_parent) = workers.replace((process, Arc::clone(&made))) {
        std::mem::forget(of_parent);
    }
    Ok(made)
}
