//! The time that a device measured itself, by stage.

use std::collections::BTreeMap;

use serde::Serialize;

/// What a device did since the last read.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Profile {
    /// Device time by stage, in the order in which the stages first ran.
    pub stages: Vec<StageTime>,
    /// Passes beyond those that can be timed.
    pub untimed_passes: u64,
    /// What each kernel did.
    pub kernels: BTreeMap<&'static str, KernelWork>,
    /// Submissions, those of uploads included.
    pub submits: u64,
    /// How often the host waited for the device.
    pub waits: u64,
}

/// Device time of a stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// Name of the stage: `boundary`, `refine`, …
    pub stage: &'static str,
    /// Number of passes.
    pub passes: u64,
    /// Their total time.
    pub milliseconds: f64,
}

/// What a kernel did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct KernelWork {
    /// Dispatches, those without work included.
    pub dispatches: u64,
    /// Faces, clusters or entries that it was called for.
    pub items: u64,
    /// Of listed faces, those that were due.
    pub due: u64,
    /// Bytes that it read and wrote, by the table of kernels.
    pub bytes: u64,
}

impl std::ops::AddAssign for KernelWork {
    fn add_assign(&mut self, more: Self) {
        self.dispatches += more.dispatches;
        self.items += more.items;
        self.due += more.due;
        self.bytes += more.bytes;
    }
}

impl Profile {
    /// Dispatches and bytes of all kernels.
    pub fn total(&self) -> KernelWork {
        self.kernels.values().fold(KernelWork::default(), |mut sum, work| {
            sum += *work;
            sum
        })
    }
}
