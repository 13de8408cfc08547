//! Numbers of the process, under the names that every Prometheus client library gives them. Where the system does not
//! tell a number (other systems than Linux), it is 0.

use std::sync::atomic::{AtomicU64, Ordering};

use prometheus_client::metrics::gauge::Gauge;

use super::families::{Seconds, metrics};
use crate::ops::proc_bytes;

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

impl Families {
    /// Sets what changes while the process runs.
    pub fn measure(&self) {
        self.cpu_seconds.inner().store(cpu_seconds().to_bits(), Ordering::Relaxed);
        // the folder that is read is one of them
        let open = std::fs::read_dir("/proc/self/fd").map_or(0, |entries| entries.count().saturating_sub(1));
        self.open_fds.set(open as i64);
        if let Ok((limit, _)) = rlimit::Resource::NOFILE.get() {
            self.max_fds.set(i64::try_from(limit).unwrap_or(i64::MAX));
        }
        if let Some(bytes) = proc_bytes("/proc/self/status", "VmRSS:") {
            self.resident.set(bytes.cast_signed());
        }
    }
}

/// Processor time of all threads of this process, in seconds.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
