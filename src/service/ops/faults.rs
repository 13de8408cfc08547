//! Failures on purpose: named points at which a test makes the service fail as a disk or a device would, or wait.
//!
//! In builds without debug assertions nothing fails or waits, and a point costs nothing.

use std::io;
use std::sync::Arc;

use parking_lot::{Condvar, Mutex};

/// Where something can be made to fail, or to wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultPoint {
    /// Before a transaction of the store is committed.
    Commit,
    /// Before a part of an upload or a result is written.
    WriteBlob,
    /// Before an upload or a result is read.
    ReadBlob,
    /// Before the folder is looked at.
    ProbeFolder,
    /// Before a request is looked at that is no probe, on a thread that answers requests.
    Request,
    /// When the device is done with a job, before results are made of what it gave.
    Finish,
}

/// The faults that are armed; clones share them.
#[derive(Debug, Clone, Default)]
pub struct Faults {
    armed: Arc<Mutex<Vec<Armed>>>,
    /// Points that are held, with the number of threads that wait there.
    held: Arc<Mutex<Vec<(FaultPoint, usize)>>>,
    released: Arc<Condvar>,
}

#[derive(Debug)]
struct Armed {
    point: FaultPoint,
    kind: io::ErrorKind,
    /// Times that the point is still passed, then times that it fails.
    passes: usize,
    failures: usize,
}

impl Faults {
    /// `point` is passed `after` times, then fails `times` times with an error of `kind`.
    pub fn arm(&self, point: FaultPoint, kind: io::ErrorKind, after: usize, times: usize) {
        self.armed.lock().push(Armed { point, kind, passes: after, failures: times });
    }

    /// From now on, every thread that reaches `point` waits there: a thread of the runtime at [`FaultPoint::Request`].
    pub fn hold(&self, point: FaultPoint) {
        self.held.lock().push((point, 0));
    }

    /// Number of threads that wait at a point.
    pub fn waiting(&self, at: FaultPoint) -> usize {
        self.held.lock().iter().find(|(point, _)| *point == at).map_or(0, |(_, waiting)| *waiting)
    }

    /// Ends all faults and all waits.
    pub fn disarm(&self) {
        self.armed.lock().clear();
        self.held.lock().clear();
        self.released.notify_all();
    }

    /// Aborts the process when `TEST_ABORT_AT_FILE` is the name of this file, as a mesh would that takes all memory.
    pub(crate) fn abort_at(&self, file_name: Option<&str>) {
        let is_wanted = |name| std::env::var("TEST_ABORT_AT_FILE").is_ok_and(|wanted| wanted == name);
        if cfg!(debug_assertions) && file_name.is_some_and(is_wanted) {
            std::process::abort();
        }
    }

    pub(crate) fn pass(&self, at: FaultPoint) {
        if !cfg!(debug_assertions) {
            return;
        }
        let mut held = self.held.lock();
        if let Some((_, waiting)) = held.iter_mut().find(|(point, _)| *point == at) {
            *waiting += 1;
        }
        while held.iter().any(|(point, _)| *point == at) {
            self.released.wait(&mut held);
        }
    }

    /// An error when a fault is armed for this point; waits first when it is held.
    pub(crate) fn hit(&self, point: FaultPoint) -> io::Result<()> {
        if !cfg!(debug_assertions) {
            return Ok(());
        }
        self.pass(point);
        let mut armed = self.armed.lock();
        for fault in armed.iter_mut().filter(|fault| fault.point == point) {
            if fault.passes > 0 {
                fault.passes -= 1;
            } else if fault.failures > 0 {
                fault.failures -= 1;
                return Err(fault.kind.into());
            }
        }
        Ok(())
    }
}
