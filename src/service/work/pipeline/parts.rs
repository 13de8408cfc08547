//! What a pipeline is made of.

use std::sync::Arc;
use std::time::Duration;

use tesserae_mesh::mesh::Limits;
use tokio::sync::{Semaphore, watch};

use super::device_thread::DeviceThread;
use super::leases::Leases;
use super::memory::Memory;
use super::small::SmallMeshes;
use crate::files::Files;
use crate::files::storage::Storage;
use crate::metrics::Metrics;
use crate::ops::faults::Faults;
use crate::queue::Shares;
use crate::store::Store;
use crate::store::live::Live;

#[derive(Debug)]
pub(crate) struct Pipeline {
    pub store: Arc<Store>,
    pub files: Arc<Files>,
    pub storage: Arc<Storage>,
    pub device: DeviceThread,
    /// What a mesh may cost.
    pub limits: Limits,
    /// Time that the device may take for a job.
    pub time: Option<Duration>,
    /// Time after which a job fails that cannot read or write its files.
    pub patience: Duration,
    /// For each mesh in memory.
    pub slots: Arc<Semaphore>,
    /// The one slot for a tenant without a running job.
    pub newcomer: Arc<Semaphore>,
    pub shares: watch::Receiver<Arc<Shares>>,
    /// Name of this process for clients.
    pub worker: Arc<str>,
    pub faults: Faults,
    pub memory: Memory,
    pub small: SmallMeshes,
    pub leases: Arc<Leases>,
    pub metrics: Arc<Metrics>,
    pub live: Arc<Live>,
}
