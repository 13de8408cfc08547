//! What alert rules compare with: room, limits, and how long the oldest job waits.

use std::sync::atomic::AtomicU64;
use std::time::Duration;

use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Registry, Unit};

use crate::service::Settings;

/// Room of the data folder and wait of the queue, measured when somebody looks.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::service) struct Room {
    /// Bytes that may still be written to the file system of the data folder; none where the system does not tell.
    pub disk_free: Option<u64>,
    /// Age of the job that waits longest; none when no job waits.
    pub oldest_queued: Option<Duration>,
}

/// The gauges.
#[derive(Debug)]
pub(super) struct Limits {
    disk_free: Gauge,
    disk_limit: Gauge,
    disk_reserve: Gauge,
    queue_limit: Gauge,
    queue_oldest: Gauge<f64, AtomicU64>,
}

impl Limits {
    /// Registers the gauges.
    pub fn register(registry: &mut Registry) -> Self {
        let new = Self {
            disk_free: Gauge::default(),
            disk_limit: Gauge::default(),
            disk_reserve: Gauge::default(),
            queue_limit: Gauge::default(),
            queue_oldest: Gauge::default(),
        };
        let bytes = || Unit::Bytes;
        let help = "Bytes that may still be written to the file system of the data folder";
        registry.register_with_unit("disk_free", help, bytes(), new.disk_free.clone());
        let help = "Bytes in the data folder above which uploads are refused; 0 for no limit";
        registry.register_with_unit("disk_limit", help, bytes(), new.disk_limit.clone());
        let help = "Free bytes below which uploads are refused";
        registry.register_with_unit("disk_reserve", help, bytes(), new.disk_reserve.clone());
        registry.register("queue_limit", "Jobs that may wait", new.queue_limit.clone());
        let help = "Age of the job that waits longest; 0 when none waits";
        registry.register_with_unit("queue_oldest", help, Unit::Seconds, new.queue_oldest.clone());
        new
    }

    /// Sets what the settings say.
    pub fn set(&self, settings: &Settings) {
        let signed = |bytes: u64| i64::try_from(bytes).unwrap_or(i64::MAX);
        self.disk_limit.set(signed(settings.storage.max_disk_bytes.unwrap_or(0)));
        self.disk_reserve.set(signed(settings.storage.min_free_bytes));
        self.queue_limit.set(signed(settings.max_queued_jobs as u64));
    }

    /// Sets what was measured.
    pub fn measured(&self, room: Room) {
        if let Some(free) = room.disk_free {
            self.disk_free.set(i64::try_from(free).unwrap_or(i64::MAX));
        }
        self.queue_oldest.set(room.oldest_queued.unwrap_or_default().as_secs_f64());
    }
}
