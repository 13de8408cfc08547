//! Failures on purpose: named points at which a test makes the service fail as a disk or a device would.
//!
//! In builds without debug assertions nothing can be armed, and a point costs nothing.

use std::io;
#[cfg(debug_assertions)]
use std::sync::{Arc, Mutex, PoisonError};

/// Where something can be made to fail.
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
}

/// The faults that are armed; clones share them.
#[derive(Debug, Clone, Default)]
pub struct Faults {
    #[cfg(debug_assertions)]
    armed: Arc<Mutex<Vec<Armed>>>,
}

#[cfg(debug_assertions)]
#[derive(Debug)]
struct Armed {
    point: FaultPoint,
    kind: io::ErrorKind,
    /// Times that the point is still passed, then times that it fails.
    passes: usize,
    failures: usize,
}

impl Faults {
    /// From the time `after` on, `point` fails `times` times as `kind` says.
    #[cfg(debug_assertions)]
    pub fn arm(&self, point: FaultPoint, kind: io::ErrorKind, after: usize, times: usize) {
        let armed = Armed { point, kind, passes: after, failures: times };
        self.armed.lock().unwrap_or_else(PoisonError::into_inner).push(armed);
    }

    /// Nothing fails any more.
    #[cfg(debug_assertions)]
    pub fn disarm(&self) {
        self.armed.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// An error when a fault is armed for this point.
    #[cfg(debug_assertions)]
    pub(super) fn hit(&self, point: FaultPoint) -> io::Result<()> {
        let mut armed = self.armed.lock().unwrap_or_else(PoisonError::into_inner);
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

    /// Nothing, in this build.
    #[cfg(not(debug_assertions))]
    #[inline]
    pub(super) fn hit(&self, _: FaultPoint) -> io::Result<()> {
        Ok(())
    }
}
