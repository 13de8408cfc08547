//! How many bytes of uploads may be coming in at a time, all clients together.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tesserae_mesh::error::{Error, Kind, Result};

/// The bytes that are coming in, and how many may be.
#[derive(Debug)]
pub(crate) struct Budget {
    limit: u64,
    held: AtomicU64,
}

/// The bytes of one upload; given back when dropped.
#[derive(Debug)]
pub(crate) struct Held {
    budget: Arc<Budget>,
    bytes: u64,
}

impl Budget {
    pub fn new(limit: u64) -> Self {
        Self { limit, held: AtomicU64::new(0) }
    }

    /// Begins an upload of `declared` bytes: refused when they do not fit now.
    pub fn begin(self: &Arc<Self>, declared: Option<u64>) -> Result<Held> {
        match declared {
            Some(bytes) if self.held().saturating_add(bytes) > self.limit => Err(self.exceeded()),
            _ => Ok(Held { budget: Arc::clone(self), bytes: 0 }),
        }
    }

    pub fn held(&self) -> u64 {
        self.held.load(Ordering::Relaxed)
    }

    fn exceeded(&self) -> Error {
        Error::new(
            Kind::Overloaded,
            format_args!("uploads of as many bytes are coming in as may; try again later: {}", self.limit),
        )
    }
}

impl Held {
    pub fn add(&mut self, bytes: u64) -> Result<()> {
        self.bytes += bytes;
        let before = self.budget.held.fetch_add(bytes, Ordering::Relaxed);
        if before.saturating_add(bytes) > self.budget.limit { Err(self.budget.exceeded()) } else { Ok(()) }
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.budget.held.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}
