//! What a pipeline is made of.

use std::sync::Arc;
use std::time::Duration;

use tesserae_mesh::error::Result;
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
pub(crate) struct Parts {
    pub store: Arc<Store>,
    pub files: Arc<Files>,
    pub storage: Arc<Storage>,
    pub device: DeviceThread,
    pub metrics: Arc<Metrics>,
    pub live: Arc<Live>,
    pub shares: watch::Receiver<Arc<Shares>>,
    pub worker: Arc<str>,
    pub faults: Faults,
    /// What a mesh may cost.
    pub limits: Limits,
    /// Meshes in memory at a time.
    pub slots: usize,
    /// Bytes of memory for all meshes; most of what there is when none.
    pub memory: Option<u64>,
    /// Time that the device may take for a job.
    pub time: Option<Duration>,
    /// Time after which a job fails that cannot read or write its files.
    pub patience: Duration,
}

#[derive(Debug)]
pub(crate) struct Pipeline {
    pub(super) store: Arc<Store>,
    pub(super) files: Arc<Files>,
    pub(super) storage: Arc<Storage>,
    pub(super) device: DeviceThread,
    pub(super) limits: Limits,
    pub(super) time: Option<Duration>,
    pub(super) patience: Duration,
    pub(super) slots: Arc<Semaphore>,
    /// The one slot for a tenant without a running job.
    pub(super) newcomer: Arc<Semaphore>,
    pub(super) shares: watch::Receiver<Arc<Shares>>,
    pub(super) worker: Arc<str>,
    pub(super) faults: Faults,
    pub(super) memory: Memory,
    pub(super) small: SmallMeshes,
    pub(super) leases: Arc<Leases>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) live: Arc<Live>,
}

impl Pipeline {
    pub fn start(parts: Parts) -> Result<Self> {
        let Parts { store, files, storage, device, metrics, live, shares, worker, faults, .. } = parts;
        Ok(Self {
            store,
            files,
            storage,
            device,
            limits: parts.limits,
            time: parts.time,
            patience: parts.patience,
            slots: Arc::new(Semaphore::new(parts.slots)),
            newcomer: Arc::new(Semaphore::new(1)),
            shares,
            worker,
            faults,
            memory: Memory::new(parts.memory),
            small: SmallMeshes::start()?,
            leases: Arc::new(Leases::default()),
            metrics,
            live,
        })
    }

    /// The memory for meshes, which other work on meshes takes from too.
    pub fn memory(&self) -> Memory {
        self.memory.clone()
    }
}
