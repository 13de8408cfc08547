//! From the queue to results: read → cluster → write, for several jobs at a time.
//!
//! Jobs are claimed fairly among tenants ([`super::store`]). Each holds a slot until it ends, so that no more meshes are in
//! memory than there are slots, and one more slot that only a tenant without a running job gets: a tenant that fills all
//! others holds no other tenant up. A job waits for its share of [`memory`] before it is read; within that, meshes are read and results made and
//! written on tokio's blocking threads while the one [`device_thread`] clusters; [`small`] meshes have threads of their own. A job that fails, or panics, fails alone.
//!
//! An attempt at a job comes to one of three verdicts. The job has ended; or it is released, because the device, the
//! disk or the process failed and not the mesh; or it belongs to somebody else by now. What cannot be stored is stored once
//! the disk works again: nothing is given up for it.

mod beside;
mod bounds;
pub(super) mod device_thread;
mod leases;
mod memory;
mod parts;
mod run;
mod slot;
mod small;
mod stages;
mod task;
mod turns;

pub(super) use self::parts::{Costs, Parts, Pipeline};
