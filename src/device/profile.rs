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
    /// Dispatches of each kernel, those without workgroups included.
    pub dispatches: BTreeMap<&'static str, u64>,
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
