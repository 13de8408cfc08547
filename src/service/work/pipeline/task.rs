//! A mesh on its way through the device, and the results after it.

use std::sync::Arc;
use std::time::Instant;

use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::job::{self, Clustered, Outcome, Prepared};

use super::bounds::caught;
use super::memory::Slot;
use super::rows::OnRow;

use crate::metrics::Metrics;
use crate::ops::faults::{FaultPoint, Faults};

pub(super) struct Task {
    pub prepared: Arc<Prepared>,
    /// Requests a stop. Every look at it counts as a sign of life of the device's thread.
    pub cancel: Cancel,
    /// About how much work it is, to tell short meshes from long ones; not 0.
    pub cost: u64,
    /// Whether an earlier attempt at this mesh failed, maybe with the device.
    pub is_retry: bool,
    /// Receives every row of the report.
    pub on_row: OnRow,
    /// Where the lines of the log belong.
    pub span: tracing::Span,
    /// Freed when the mesh is: other meshes wait for its place in memory.
    pub slot: Slot,
}

/// A mesh that the device is done with.
pub(super) struct Done {
    prepared: Arc<Prepared>,
    clustered: Clustered,
    /// As that of the [`Task`].
    _slot: Slot,
}

impl Task {
    /// Runs `work` on a device. All rows of the job are delivered, and after a failure its place is free, when this
    /// returns.
    pub fn run(mut self, work: impl FnOnce(&mut Self) -> Result<Clustered>) -> Result<Done> {
        let span = self.span.clone();
        let clustered = span.in_scope(|| caught(|| work(&mut self)))?;
        Ok(Done { prepared: self.prepared, clustered, _slot: self.slot })
    }

    /// What a device has to do with it.
    pub fn cluster(&mut self, device: &mut dyn Device, metrics: &Metrics) -> Result<Clustered> {
        let started = Instant::now();
        let clustered = job::cluster(&self.prepared, device, &self.cancel, &mut *self.on_row);
        metrics.families.device_busy.inc_by(started.elapsed().as_secs_f64());
        clustered
    }
}

impl Done {
    /// Makes results, and frees the mesh.
    pub fn finish(self, faults: &Faults) -> Result<Outcome> {
        faults.hit(FaultPoint::Finish).map_err(|error| Error::io("the results cannot be made", error))?;
        job::finish(&self.prepared, self.clustered)
    }
}
