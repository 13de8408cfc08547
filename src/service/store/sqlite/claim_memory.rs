//! State that claims keep between them and that other commands read.

use std::time::SystemTime;

use super::super::fairness::VirtualTimes;

/// What one claim leaves for the next; each field is valid by itself.
#[derive(Debug, Default)]
pub(super) struct ClaimMemory {
    /// Which tenant comes next among equals.
    pub virtual_times: VirtualTimes,
    /// Whether the last claim left waiting jobs, so that the end of a job may let another one start.
    pub has_held_back: bool,
    /// When one of them may start, if that needs time only.
    pub next_start: Option<SystemTime>,
}
