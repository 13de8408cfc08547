//! From the queue to results: read → cluster → write, for several jobs at a time.
//!
//! Jobs are claimed fairly among tenants ([`crate::store`]). A job holds a slot until it ends, which bounds the meshes
//! in memory. One more slot is for tenants without a running job, so that no tenant that fills all others delays them.
//! A job waits for its share of [`memory`] before its mesh is read. Reading and writing run on tokio's blocking threads
//! while the one [`device_thread`] clusters; [`small`] meshes have threads of their own. A job that fails, or panics,
//! fails alone. Work on files that fails is repeated for a while ([`bounds`]), and writes to the store until the disk
//! works. `run` is the loop over jobs, `stages` the work on one.

mod bounds;
pub(crate) mod device_thread;
mod leases;
mod memory;
mod rows;
mod run;
mod small;
mod stages;
mod turns;

pub(crate) use self::memory::{Memory, Needed};
pub(crate) use self::run::{Pipeline, worker_name};
