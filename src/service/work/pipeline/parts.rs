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
use crate::guard::access::tokens::Tokens;
use crate::metrics::Metrics;
use crate::ops::faults::Faults;
use crate::store::Store;
use crate::store::live::Live;

pub(crate) struct Pipeline {
    pub store: Arc<Store>,
    pub files: Arc<Files>,
    pub storage: Arc<Storage>,
    pub device: DeviceThread,
    pub limits: Limits,
    /// Time that the device may take for a job.
    pub time: Option<Duration>,
    /// Time after which a job fails that cannot read or write its files.
    pub patience: Duration,
    /// For each mesh in memory.
    pub slots: Arc<Semaphore>,
    /// The one slot for a tenant without a running job.
    pub newcomer: Arc<Semaphore>,
    /// With what each tenant may use of the queue.
    pub tokens: watch::Receiver<Arc<Tokens>>,
    /// Name of this process for clients, and that of its device.
    pub worker: Arc<str>,
    pub device_name: String,
    pub faults: Faults,
    pub memory: Memory,
    pub small: SmallMeshes,
    pub leases: Arc<Leases>,
    pub metrics: Arc<Metrics>,
    pub live: Arc<Live>,
}

/// Longest name of a host that a worker is named after, in bytes.
const MAX_HOST: usize = 128;

/// Name of this process in the jobs that it works on: host name and process id.
pub(crate) fn worker_name() -> String {
    let file = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let host = file.or_else(|| std::env::var("HOSTNAME").ok()).map(|host| host.trim().to_owned());
    let host = host.filter(|host| (1..=MAX_HOST).contains(&host.len()) && host.chars().all(|c| c.is_ascii_graphic()));
    format!("{}-{}", host.as_deref().unwrap_or("tesserae"), std::process::id())
}
