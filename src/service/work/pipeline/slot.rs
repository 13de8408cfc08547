//! The place of a mesh among those in memory.

use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::OwnedSemaphorePermit;

use super::memory;

/// The place of a mesh in memory, shared by all that works on it.
#[derive(Debug, Clone)]
pub(super) struct Slot(Arc<HeldSlot>);

#[derive(Debug)]
struct HeldSlot {
    _slot: OwnedSemaphorePermit,
    memory: Mutex<Option<memory::Held>>,
}

impl Slot {
    pub fn new(slot: OwnedSemaphorePermit) -> Self {
        Self(Arc::new(HeldSlot { _slot: slot, memory: Mutex::default() }))
    }

    /// Holds the job's share of memory, too.
    pub fn holds(&self, memory: memory::Held) {
        *self.0.memory.lock() = Some(memory);
    }
}
