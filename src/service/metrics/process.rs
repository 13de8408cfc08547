//! Numbers of the process, under the names that every Prometheus client library gives them. Where the system does not
//! tell a number (other systems than Linux), it is 0.

use std::sync::atomic::AtomicU64;
use std::time::{SystemTime, UNIX_EPOCH};

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

/// The metrics `process_…`.
#[derive(Debug)]
pub(super) struct Process {
    registry: Registry,
    cpu_seconds: Counter<f64, AtomicU64>,
    open_fds: Gauge,
    max_fds: Gauge,
    resident: Gauge,
}

impl Process {
    /// Registers the metrics, in a registry of their own: their names have no prefix.
    pub fn new() -> Self {
        let mut registry = Registry::with_prefix("process");
        let started: Gauge<f64, AtomicU64> = Gauge::default();
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        started.set(now.as_secs_f64());
        let (cpu_seconds, open_fds, max_fds, resident) =
            (Counter::<f64, AtomicU64>::default(), Gauge::default(), Gauge::default(), Gauge::default());
        registry.register("start_time_seconds", "When the service started, in seconds since 1970", started);
        registry.register("cpu_seconds", "Processor time of the process", cpu_seconds.clone());
        registry.register("open_fds", "Open file descriptors", open_fds.clone());
        registry.register("max_fds", "File descriptors that may be open", max_fds.clone());
        registry.register("resident_memory_bytes", "Memory that is in use", resident.clone());
        Self { registry, cpu_seconds, open_fds, max_fds, resident }
    }

    /// The metrics as they are now.
    pub fn measured(&self) -> &Registry {
        if let Some(seconds) = cpu_seconds() {
            self.cpu_seconds.inner().store(seconds.to_bits(), std::sync::atomic::Ordering::Relaxed);
        }
        // the folder that is read is one of them
        let open = std::fs::read_dir("/proc/self/fd").map_or(0, |entries| entries.count().saturating_sub(1));
        self.open_fds.set(open as i64);
        #[cfg(unix)]
        if let Ok((limit, _)) = rlimit::Resource::NOFILE.get() {
            self.max_fds.set(i64::try_from(limit).unwrap_or(i64::MAX));
        }
        if let Some(bytes) = resident_bytes() {
            self.resident.set(bytes);
        }
        &self.registry
    }
}

/// Processor time of all threads of this process, in seconds.
#[cfg(unix)]
fn cpu_seconds() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9)
}

/// Processor time of all threads of this process, in seconds.
#[cfg(not(unix))]
fn cpu_seconds() -> Option<f64> {
    None
}

/// Memory of this process that is in use, where the system tells (Linux).
pub(super) fn resident_bytes() -> Option<i64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: i64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}
