//! What claims remember between them, and other commands ask about.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use super::super::fairness::Turns;

/// What the claims have to remember between them.
#[derive(Debug, Default)]
pub(super) struct Claims(Mutex<Memory>);

/// What [`Claims`] guards; each field is valid by itself.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// Which tenant comes next among equals.
    pub turns: Turns,
    /// Whether jobs waited when the last claim was made that it did not take.
    pub has_held_back: bool,
    /// When one of them may start, if that needs time only.
    pub next_start: Option<SystemTime>,
}

impl Claims {
    /// Whether the end of a job may let another one start.
    pub fn has_held_back(&self) -> bool {
        self.lock().has_held_back
    }

    /// When a job may start that was held back.
    pub fn next_start(&self) -> Option<SystemTime> {
        self.lock().next_start
    }

    /// The memory.
    pub fn lock(&self) -> MutexGuard<'_, Memory> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
