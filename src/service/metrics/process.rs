//! Numbers of the process, under the names that every Prometheus client library gives them. Where the system does not
//! tell a number (other systems than Linux), it is 0.

use std::sync::atomic::AtomicU64;
use std::time::{SystemTime, UNIX_EPOCH};

use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

use super::families::{Seconds, metrics};

metrics! {
    /// The metrics `process_…`.
    Families {
        started: Gauge<f64, AtomicU64>, "start_time_seconds", "When the service started, in seconds since 1970";
        cpu_seconds: Seconds, "cpu_seconds", "Processor time of the process";
        open_fds: Gauge, "open_fds", "Open file descriptors";
        max_fds: Gauge, "max_fds", "File descriptors that may be open";
        resident: Gauge, "resident_memory_bytes", "Memory that is in use";
    }
}

#[derive(Debug)]
pub(super) struct Process {
    registry: Registry,
    families: Families,
}

impl Process {
    /// Registers the metrics, in a registry of their own: their names have no prefix.
    pub fn new() -> Self {
        let mut registry = Registry::with_prefix("process");
        let families = Families::register(&mut registry);
        families.started.set(SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64());
        Self { registry, families }
    }

    pub fn measured(&self) -> &Registry {
        self.families.cpu_seconds.inner().store(cpu_seconds().to_bits(), std::sync::atomic::Ordering::Relaxed);
        // the folder that is read is one of them
        let open = std::fs::read_dir("/proc/self/fd").map_or(0, |entries| entries.count().saturating_sub(1));
        self.families.open_fds.set(open as i64);
        if let Ok((limit, _)) = rlimit::Resource::NOFILE.get() {
            self.families.max_fds.set(i64::try_from(limit).unwrap_or(i64::MAX));
        }
        if let Some(bytes) = resident_bytes() {
            self.families.resident.set(bytes);
        }
        &self.registry
    }
}

/// Processor time of all threads of this process, in seconds.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Memory of this process that is in use, where the system tells (Linux).
fn resident_bytes() -> Option<i64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: i64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}
