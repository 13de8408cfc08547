//! Surfaces that are brought to the device ahead of their turn, by another thread than the one that works with it.
//!
//! What was brought waits in the pool of its connection ([`Pool`](super::pool::Pool)), two surfaces at most, and whoever had one
//! brought has a [`Ticket`]. The device takes it when it opens the surface; it is gone when the ticket is dropped, when two more
//! were brought since, when memory runs short, and with the connection. Then it is brought when the surface is opened, as if
//! nothing had been.
//!
//! What goes wrong here is nobody else's: wgpu tells the thread that met it ([`Connection::guarded`]), so that the job that is
//! running does not learn of it. It may take memory that the job needs next: that gets it back where it makes a buffer
//! ([`Connection::needed_buffer`]). Where wgpu does so itself, for labels and lists of merges, a device without any left is lost;
//! so it is without this, and then the job runs again.

use std::fmt;
use std::sync::{Arc, Mutex};

use super::FaultPoint;
use super::buffers::check_groups;
use super::connection::{Connection, lock};
use super::fixed::Fixed;
use crate::device::{Uploaded, Uploader};
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// Brings surfaces to whatever connection is open.
#[derive(Debug)]
pub(super) struct Ahead {
    pub(super) opened: Arc<Mutex<Option<Arc<Connection>>>>,
}

/// Stands for what was brought, on one connection.
pub(super) struct Ticket {
    connection: Arc<Connection>,
    number: u64,
}

impl fmt::Debug for Ticket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ticket").field("number", &self.number).finish_non_exhaustive()
    }
}

impl Uploader for Ahead {
    fn upload(&self, graph: &DualGraph) -> Result<Uploaded> {
        let opened = lock(&self.opened).clone();
        let connection = opened.ok_or_else(|| Error::new(Kind::DeviceLost, "the gpu is not open"))?;
        let bringing = lock(&connection.bringing);
        connection.check()?;
        check_groups(&connection, graph)?;
        let fixed = connection.guarded(|| {
            connection.reach(FaultPoint::Ahead);
            Fixed::bring(&connection, graph)
        })?;
        let number = lock(&connection.pool).keep_ahead(fixed);
        drop(bringing);
        Ok(Box::new(Ticket { connection, number }))
    }
}

impl Ticket {
    /// What was brought of this surface, if it is on this connection, and still there.
    pub(super) fn redeem(self, connection: &Connection, graph: &DualGraph) -> Option<Fixed> {
        let is_here = std::ptr::eq(Arc::as_ptr(&self.connection), connection);
        let fixed = if is_here { lock(&connection.pool).take_ahead(self.number) } else { None };
        fixed.filter(|fixed| fixed.is_as_large_as(graph))
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        lock(&self.connection.pool).take_ahead(self.number);
    }
}
